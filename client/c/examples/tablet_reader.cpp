// A tablet reader: writes a circle of 2 cm, twice, as a pen would.
#include <cmath>
#include <foretrace/foretrace.hpp>
#include <iostream>
#include <thread>

int main() try {
  foretrace::Attachment attachment;
  foretrace::Pen pen = attachment.pen("circle");
  for (int step = 0; step < 800; ++step) {
    const double angle = 2.0 * 3.141592653589793 * step / 400.0;
    foretrace_pen_sample sample{};
    sample.device_stamp_ns = foretrace::now_ns();
    sample.x_m = 0.02 * std::sin(angle);
    sample.y_m = 0.02 * std::cos(angle);
    sample.pressure = -1.0F;
    sample.flags = FORETRACE_PEN_CONTACT | FORETRACE_PEN_IN_RANGE;
    pen.send(sample);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return 0;
} catch (const foretrace::Error &error) {
  std::cerr << error.what() << '\n';
  return 1;
}
