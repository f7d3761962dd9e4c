/* A tablet reader: writes a circle of 2 cm, twice, as a pen would. */
#include <foretrace/foretrace.h>
#include <math.h>
#include <stdio.h>
#include <time.h>

static int failed(const char *what) {
  fprintf(stderr, "%s: %s\n", what, foretrace_last_error());
  return 1;
}

int main(void) {
  foretrace_handle attachment = 0, pen = 0;
  if (foretrace_attach(0, 0, &attachment) != 0) return failed("attach");
  if (foretrace_pen(attachment, "circle", 0, &pen) != 0) return failed("pen");
  for (int step = 0; step < 800; ++step) {
    const double angle = 2.0 * 3.141592653589793 * step / 400.0;
    foretrace_pen_sample sample = {0};
    sample.device_stamp_ns = foretrace_now_ns();
    sample.x_m = 0.02 * sin(angle);
    sample.y_m = 0.02 * cos(angle);
    sample.pressure = -1.0F;
    sample.flags = FORETRACE_PEN_CONTACT | FORETRACE_PEN_IN_RANGE;
    if (foretrace_pen_send(pen, &sample, sizeof sample, NULL) != 0) return failed("send");
    const struct timespec pause = {0, 5000000};
    nanosleep(&pause, NULL);
  }
  foretrace_close(pen);
  foretrace_close(attachment);
  return 0;
}
