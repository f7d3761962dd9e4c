// Watches a running daemon for three seconds: ticks, lateness, mode.
#include <foretrace/foretrace.hpp>
#include <iostream>
#include <thread>

int main() try {
  using namespace std::chrono_literals;
  foretrace::Attachment attachment;
  foretrace::Telemetry telemetry = attachment.telemetry();
  foretrace::StatusReader reader = attachment.status();
  std::size_t ticks = 0;
  for (int round = 0; round < 30; ++round) {
    std::this_thread::sleep_for(100ms);
    ticks += telemetry.read().size();
  }
  const foretrace_status status = reader.next(1s);
  std::cout << ticks << " ticks in 3 s, " << telemetry.lost() << " lost; " << foretrace_mode_label(status.mode)
            << "; whole step p99 " << status.stages[FORETRACE_STAGE_STEP].p99_ns << " ns\n";
  return 0;
} catch (const foretrace::Error &error) {
  std::cerr << error.what() << '\n';
  return 1;
}
