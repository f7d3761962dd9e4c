/* Calls that are wrong: each has its error code and nothing else happens. Run under the sanitizers. */
#include <foretrace/foretrace.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int checks = 0;

static void expect(int line, int found, int wanted) {
  ++checks;
  if (found == wanted && (wanted == 0 || strlen(foretrace_last_error()) > 0)) return;
  fprintf(stderr, "line %d: %d, not %d: %s\n", line, found, wanted, foretrace_last_error());
  exit(1);
}
#define EXPECT(call, code) expect(__LINE__, (call), (code))

static foretrace_handle shared = 0;

static void *in_another_thread(void *nothing) {
  bool up = false;
  EXPECT(foretrace_daemon_is_up(shared, &up), FORETRACE_BAD_HANDLE);
  EXPECT(foretrace_close(shared), FORETRACE_BAD_HANDLE);
  return nothing;
}

/* Without a daemon. */
static void nothing_runs(void) {
  foretrace_handle handle = 7;
  char text[8];
  EXPECT(foretrace_attach(77, 0, &handle), FORETRACE_NO_DAEMON);
  EXPECT(handle != 0, 0);
  EXPECT(foretrace_attach(77, 0, NULL), FORETRACE_NULL);
  EXPECT(foretrace_attach_as(1, 77, 0, &handle), FORETRACE_OTHER_LAYOUT);
  EXPECT(foretrace_stop(77, 1000000, text, sizeof text), FORETRACE_NO_DAEMON);
  EXPECT(foretrace_gateway(NULL, &handle), FORETRACE_BAD_ARGUMENT);
  EXPECT(foretrace_gateway("/no/such/socket", &handle), FORETRACE_NOT_SENT);
  EXPECT(foretrace_gateway("\xff", &handle), FORETRACE_BAD_ARGUMENT);
  char *path = malloc(100000);
  memset(path, 'x', 99999);
  path[99999] = '\0';
  EXPECT(foretrace_gateway(path, &handle), FORETRACE_BAD_ARGUMENT);
  free(path);
  const foretrace_handle never[] = {0, 1000000, UINT64_MAX};
  for (size_t i = 0; i < 3; ++i) {
    bool flag;
    foretrace_joint_command command;
    EXPECT(foretrace_close(never[i]), FORETRACE_BAD_HANDLE);
    EXPECT(foretrace_daemon_is_up(never[i], &flag), FORETRACE_BAD_HANDLE);
    EXPECT(foretrace_pen(never[i], NULL, 0, &handle), FORETRACE_BAD_HANDLE);
    EXPECT(foretrace_commands_latest(never[i], &command, sizeof command, &flag), FORETRACE_BAD_HANDLE);
    EXPECT(foretrace_dead_man_beat(never[i]), FORETRACE_BAD_HANDLE);
  }
}

static void demands(void) {
  foretrace_joint_command command;
  double q[6] = {9, 9, 9, 9, 9, 9}, qd[6];
  bool follow = true;
  memset(&command, 0, sizeof command);
  EXPECT(foretrace_demand_at(&command, sizeof command, 1, q, qd, &follow), 0);
  EXPECT(follow, 0);
  command.flags = FORETRACE_COMMAND_ENABLED;
  command.valid_until_ns = 1000;
  follow = true;
  EXPECT(foretrace_demand_at(&command, sizeof command, 1, q, qd, &follow), FORETRACE_OTHER_BOOT);
  EXPECT(follow, 0);
  EXPECT(foretrace_demand_at(&command, sizeof command - 1, 1, q, qd, &follow), FORETRACE_OTHER_LAYOUT);
  EXPECT(foretrace_demand_at(&command, 0, 1, q, qd, &follow), FORETRACE_OTHER_LAYOUT);
  EXPECT(foretrace_demand_at(NULL, sizeof command, 1, q, qd, &follow), FORETRACE_NULL);
  EXPECT(foretrace_demand_at(&command, sizeof command, 1, q, qd, NULL), FORETRACE_NULL);
  EXPECT(q[0] != 9.0, 0);
}

/* Whether the daemon does, as of a status that was sent a while after now. */
static int predicts_by(foretrace_handle reader, const char *name) {
  foretrace_status status;
  const uint64_t after_ns = foretrace_now_ns() + 300000000;
  do {
    EXPECT(foretrace_status_next(reader, 2000000000, &status, sizeof status), 0);
  } while (status.header.stamp_ns < after_ns);
  return strncmp((const char *)status.predictor.bytes, name, sizeof status.predictor.bytes) == 0;
}

/* Beside a daemon. */
static void beside_a_daemon(uint32_t instance) {
  foretrace_handle attachment, pen, commands, states, telemetry, reader, dead_man, other;
  EXPECT(foretrace_attach(instance, 2000000000, &attachment), 0);
  shared = attachment;
  pthread_t thread;
  pthread_create(&thread, NULL, in_another_thread, NULL);
  pthread_join(thread, NULL);

  foretrace_pen_sample sample;
  memset(&sample, 0, sizeof sample);
  sample.pressure = -1.0F;
  EXPECT(foretrace_pen(attachment, "hostile", 0, &pen), 0);
  EXPECT(foretrace_pen(attachment, "second", 0, &other), FORETRACE_TAKEN);
  EXPECT(other != 0, 0);
  sample.device_stamp_ns = foretrace_now_ns();
  EXPECT(foretrace_pen_send(pen, &sample, sizeof sample, NULL), 0);
  EXPECT(foretrace_pen_send(pen, &sample, sizeof sample + 8, NULL), FORETRACE_OTHER_LAYOUT);
  EXPECT(foretrace_pen_send(pen, NULL, sizeof sample, NULL), FORETRACE_NULL);
  EXPECT(foretrace_pen_send(attachment, &sample, sizeof sample, NULL), FORETRACE_BAD_HANDLE);
  sample.x_m = NAN;
  EXPECT(foretrace_pen_send(pen, &sample, sizeof sample, NULL), FORETRACE_INVALID);
  sample.x_m = 120.0; /* millimetres */
  EXPECT(foretrace_pen_send(pen, &sample, sizeof sample, NULL), FORETRACE_INVALID);
  sample.x_m = 0.0;
  sample.flags = 1U << 30;
  EXPECT(foretrace_pen_send(pen, &sample, sizeof sample, NULL), FORETRACE_INVALID);
  char text[4] = "xyz";
  EXPECT(foretrace_pen_handed_to(pen, text, sizeof text), 0);
  EXPECT(text[0] != '\0', 0);
  EXPECT(foretrace_pen_handed_to(pen, NULL, 0), 0);

  foretrace_joint_state state;
  EXPECT(foretrace_commands(attachment, 0, &commands), FORETRACE_BAD_ARGUMENT);
  EXPECT(foretrace_commands(attachment, 1, &commands), 0);
  EXPECT(foretrace_commands_echo(commands, &state, sizeof state), 0);
  EXPECT(foretrace_commands_echo(commands, &state, 3), FORETRACE_OTHER_LAYOUT);
  EXPECT(foretrace_joint_states(attachment, &states), 0);
  state.q[2] = 90.0; /* degrees */
  EXPECT(foretrace_joint_states_publish(states, foretrace_now_ns(), &state, sizeof state, NULL), FORETRACE_INVALID);
  state.q[2] = INFINITY;
  EXPECT(foretrace_joint_states_publish(states, foretrace_now_ns(), &state, sizeof state, NULL), FORETRACE_INVALID);
  state.q[2] = 0.0;
  EXPECT(foretrace_joint_states_publish(states, foretrace_now_ns() + 10000000000, &state, sizeof state, NULL),
         FORETRACE_INVALID);
  EXPECT(foretrace_joint_states_note(states, "a test", NULL), 0);
  EXPECT(foretrace_joint_states_note(states, NULL, NULL), 0);

  static foretrace_tick_record records[4];
  size_t count = 9;
  EXPECT(foretrace_telemetry(attachment, &telemetry), 0);
  EXPECT(foretrace_telemetry_read(telemetry, records, sizeof records[0], 0, &count), 0);
  EXPECT(count != 0, 0);
  EXPECT(foretrace_telemetry_read(telemetry, records, sizeof records[0], 4, NULL), FORETRACE_NULL);
  foretrace_status status;
  EXPECT(foretrace_status_reader(attachment, &reader), 0);
  EXPECT(foretrace_status_next(reader, 2000000000, &status, sizeof status), 0);
  EXPECT(foretrace_status_next(reader, 2000000000, &status, sizeof status - 4), FORETRACE_OTHER_LAYOUT);
  EXPECT(foretrace_telemetry_read(telemetry, NULL, sizeof records[0], 4, &count), FORETRACE_NULL);
  EXPECT(foretrace_telemetry_read(telemetry, records, 7, 4, &count), FORETRACE_OTHER_LAYOUT);
  EXPECT(foretrace_telemetry_read(telemetry, records, sizeof records[0], 4, &count), 0);

  EXPECT(foretrace_request(attachment, 99, 0.0, NULL, 1000000000, NULL, 0), FORETRACE_BAD_ARGUMENT);
  EXPECT(foretrace_request(attachment, FORETRACE_CONTROL_OP_SET_TRUST, NAN, NULL, 1000000000, NULL, 0),
         FORETRACE_INVALID);
  EXPECT(foretrace_request(attachment, FORETRACE_CONTROL_OP_SWITCH_PREDICTOR, 0.0, NULL, 1000000000, NULL, 0),
         FORETRACE_BAD_ARGUMENT);
  EXPECT(foretrace_request(attachment, FORETRACE_CONTROL_OP_SWITCH_PREDICTOR, 0.0, "nobody", 1000000000, NULL, 0),
         FORETRACE_REFUSED);
  foretrace_control_response response;
  /* An error says that nothing was asked for. */
  EXPECT(foretrace_request(attachment, FORETRACE_CONTROL_OP_SWITCH_PREDICTOR, 0.0, "hold", 1000000000, &response, 1),
         FORETRACE_OTHER_LAYOUT);
  EXPECT(predicts_by(reader, "hold"), 0);
  EXPECT(foretrace_request(attachment, FORETRACE_CONTROL_OP_SWITCH_PREDICTOR, 0.0, "hold", 1000000000, NULL, 0), 0);
  EXPECT(predicts_by(reader, "hold"), 1);
  EXPECT(foretrace_request(attachment, FORETRACE_CONTROL_OP_QUERY, 0.0, NULL, 1000000000, &response, 1),
         FORETRACE_OTHER_LAYOUT);
  EXPECT(foretrace_request(attachment, FORETRACE_CONTROL_OP_QUERY, 0.0, NULL, 1000000000, &response, sizeof response),
         0);

  EXPECT(foretrace_dead_man(attachment, NULL, 0, &dead_man), 0);
  EXPECT(foretrace_dead_man_beat(dead_man), 0);
  EXPECT(foretrace_dead_man_beat(pen), FORETRACE_BAD_HANDLE);
  EXPECT(foretrace_dead_man_stop(dead_man), 0);

  /* A predictor: its numbers are the daemon's to judge, their count is not. */
  foretrace_handle steps, previews;
  foretrace_pen_step step;
  static foretrace_pen_preview preview;
  EXPECT(foretrace_pen_steps(attachment, &steps), 0);
  EXPECT(foretrace_pen_steps_next(steps, 1000000, &step, sizeof step), FORETRACE_NOT_SENT);
  EXPECT(foretrace_pen_steps_next(steps, 0, &step, 4), FORETRACE_OTHER_LAYOUT);
  EXPECT(foretrace_pen_steps_next(pen, 0, &step, sizeof step), FORETRACE_BAD_HANDLE);
  EXPECT(foretrace_previews(attachment, &previews), 0);
  EXPECT(foretrace_previews(attachment, &other), FORETRACE_TAKEN);
  preview.count = 64;
  preview.x_m[3] = NAN;
  EXPECT(foretrace_previews_send(previews, &preview, sizeof preview, NULL), 0);
  preview.count = 65;
  EXPECT(foretrace_previews_send(previews, &preview, sizeof preview, NULL), FORETRACE_INVALID);
  preview.count = 64;
  preview.flags = 1U << 7;
  EXPECT(foretrace_previews_send(previews, &preview, sizeof preview, NULL), FORETRACE_INVALID);
  EXPECT(foretrace_previews_send(previews, NULL, sizeof preview, NULL), FORETRACE_NULL);
  EXPECT(foretrace_previews_send(previews, &preview, sizeof preview - 8, NULL), FORETRACE_OTHER_LAYOUT);
  EXPECT(foretrace_close(previews), 0);
  EXPECT(foretrace_close(steps), 0);

  /* After the attachment is gone what it made works on; after its own end nothing does. */
  EXPECT(foretrace_close(attachment), 0);
  EXPECT(foretrace_close(attachment), FORETRACE_BAD_HANDLE);
  EXPECT(foretrace_commands(attachment, 1, &other), FORETRACE_BAD_HANDLE);
  sample.flags = 0;
  sample.device_stamp_ns = foretrace_now_ns();
  EXPECT(foretrace_pen_send(pen, &sample, sizeof sample, NULL), 0);
  EXPECT(foretrace_close(pen), 0);
  EXPECT(foretrace_pen_send(pen, &sample, sizeof sample, NULL), FORETRACE_BAD_HANDLE);
  EXPECT(foretrace_close(states), 0);
  EXPECT(foretrace_close(commands), 0);
  EXPECT(foretrace_close(telemetry), 0);
  EXPECT(foretrace_close(reader), 0);
  EXPECT(foretrace_close(dead_man), 0);
}

int main(int count, char **arguments) {
  nothing_runs();
  demands();
  if (count > 1) beside_a_daemon((uint32_t)atoi(arguments[1]));
  printf("%d calls have their codes\n", checks);
  return 0;
}
