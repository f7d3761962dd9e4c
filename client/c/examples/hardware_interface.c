/* A hardware interface at 500 Hz, for an arm that is where it is told to be at once. Ends when its standard
 * input does. */
#include <errno.h>
#include <fcntl.h>
#include <foretrace/foretrace.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static int failed(const char *what) {
  fprintf(stderr, "%s: %s\n", what, foretrace_last_error());
  return 1;
}

/* Whether there is still somebody at the other end of standard input. */
static bool wanted(void) {
  char byte;
  const ssize_t count = read(STDIN_FILENO, &byte, 1);
  return count > 0 || (count < 0 && errno == EAGAIN);
}

int main(void) {
  double q[6] = {3.1416, -1.3, 1.8, -2.0708, -1.5708, 0.0}, qd[6] = {0}; /* home of the preset ur5 */
  foretrace_handle attachment = 0, commands = 0, states = 0;
  fcntl(STDIN_FILENO, F_SETFL, O_NONBLOCK);
  if (foretrace_attach(0, 0, &attachment) != 0) return failed("attach");
  if (foretrace_commands(attachment, 1, &commands) != 0) return failed("commands");
  if (foretrace_joint_states(attachment, &states) != 0) return failed("joint states");
  while (wanted()) {
    const struct timespec pause = {0, 2000000};
    nanosleep(&pause, NULL);
    const uint64_t now_ns = foretrace_now_ns();
    foretrace_joint_command command;
    bool follow = false;
    double to[6], at[6];
    if (foretrace_commands_latest(commands, &command, sizeof command, NULL) != 0) return failed("command");
    if (foretrace_demand_at(&command, sizeof command, now_ns, to, at, &follow) != 0)
      fprintf(stderr, "brakes: %s\n", foretrace_last_error());
    if (follow) memcpy(q, to, sizeof q);
    if (follow) memcpy(qd, at, sizeof qd);
    if (!follow) memset(qd, 0, sizeof qd); /* a real arm brakes */
    foretrace_joint_state state;
    if (foretrace_commands_echo(commands, &state, sizeof state) != 0) return failed("echo");
    memcpy(state.q, q, sizeof q);
    memcpy(state.qd, qd, sizeof qd);
    state.safety_mode = FORETRACE_SAFETY_MODE_NORMAL;
    state.robot_mode = FORETRACE_ROBOT_MODE_RUNNING;
    if (foretrace_joint_states_publish(states, now_ns, &state, sizeof state, NULL) != 0)
      fprintf(stderr, "left out: %s\n", foretrace_last_error());
  }
  return 0;
}
