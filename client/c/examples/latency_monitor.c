/* Watches a running daemon for three seconds: ticks, lateness, mode. */
#include <foretrace/foretrace.h>
#include <inttypes.h>
#include <stdio.h>
#include <time.h>

static int failed(const char *what) {
  fprintf(stderr, "%s: %s\n", what, foretrace_last_error());
  return 1;
}

int main(void) {
  foretrace_handle attachment = 0, telemetry = 0, reader = 0;
  if (foretrace_attach(0, 0, &attachment) != 0) return failed("attach");
  if (foretrace_telemetry(attachment, &telemetry) != 0) return failed("telemetry");
  if (foretrace_status_reader(attachment, &reader) != 0) return failed("status");
  static foretrace_tick_record records[512];
  size_t ticks = 0;
  for (int round = 0; round < 30; ++round) {
    const struct timespec pause = {0, 100000000};
    size_t count = 0;
    nanosleep(&pause, NULL);
    if (foretrace_telemetry_read(telemetry, records, sizeof records[0], 512, &count) != 0) return failed("read");
    ticks += count;
  }
  foretrace_status status;
  uint64_t lost = 0;
  if (foretrace_status_next(reader, 1000000000, &status, sizeof status) != 0) return failed("status");
  if (foretrace_telemetry_lost(telemetry, &lost) != 0) return failed("lost");
  printf("%zu ticks in 3 s, %" PRIu64 " lost; %s; whole step p99 %" PRIu32 " ns\n", ticks, lost,
         foretrace_mode_label(status.mode), status.stages[FORETRACE_STAGE_STEP].p99_ns);
  return 0;
}
