/* A predictor in a process of its own: constant velocity, for 6 s. Choose it by `foretrace request predictor external`. */
#include <foretrace/foretrace.h>
#include <stdio.h>

static int failed(const char *what) {
  fprintf(stderr, "%s: %s\n", what, foretrace_last_error());
  return 1;
}

int main(void) {
  foretrace_handle attachment = 0, steps = 0, previews = 0;
  if (foretrace_attach(0, 0, &attachment) != 0) return failed("attach");
  if (foretrace_pen_steps(attachment, &steps) != 0) return failed("steps");
  if (foretrace_previews(attachment, &previews) != 0) return failed("previews");
  const uint64_t end_ns = foretrace_now_ns() + 6000000000;
  unsigned answered = 0;
  while (foretrace_now_ns() < end_ns) {
    foretrace_pen_step step;
    const int code = foretrace_pen_steps_next(steps, 100000000, &step, sizeof step);
    if (code == FORETRACE_NOT_SENT) continue; /* the pen is away, or another predictor is chosen */
    if (code != 0) return failed("step");
    foretrace_pen_preview preview = {0};
    preview.base_index = step.index;
    preview.count = step.wanted;
    for (unsigned i = 0; i < step.wanted; ++i) { /* dx_m, dy_m are 0 where a stroke begins */
      preview.x_m[i] = step.x_m + (i + 1) * step.dx_m;
      preview.y_m[i] = step.y_m + (i + 1) * step.dy_m;
    }
    if (foretrace_previews_send(previews, &preview, sizeof preview, NULL) != 0) return failed("send");
    ++answered;
  }
  printf("%u steps answered\n", answered);
  foretrace_close(previews);
  foretrace_close(steps);
  foretrace_close(attachment);
  return answered > 0 ? 0 : 1;
}
