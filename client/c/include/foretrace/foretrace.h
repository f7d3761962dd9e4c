/* libforetrace: attach to a running foretrace daemon from C11, or from C++17 (foretrace.hpp wraps this).
 *
 * Every function that can fail returns 0, or a code of foretrace_error; foretrace_last_error() then says what
 * was wrong and what to do. Handles are numbers and belong to the thread that opened them: in another thread,
 * or after foretrace_close, they are FORETRACE_BAD_HANDLE and nothing else happens. Messages are copied; their
 * sizes are compared. Times are nanoseconds of CLOCK_MONOTONIC. */
#ifndef FORETRACE_H
#define FORETRACE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "messages.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Something that this thread has opened; 0: nothing. */
typedef uint64_t foretrace_handle;

enum foretrace_error {
  FORETRACE_OK = 0,
  /** A pointer that must not be null is. */
  FORETRACE_NULL = 1,
  /** A size, number or text is not one that the function takes. */
  FORETRACE_BAD_ARGUMENT = 2,
  /** Closed, never opened, of another kind, or opened by another thread. */
  FORETRACE_BAD_HANDLE = 3,
  /** Header and library have other messages: build the program again. */
  FORETRACE_OTHER_LAYOUT = 4,
  /** No daemon runs under this instance. */
  FORETRACE_NO_DAEMON = 5,
  /** Daemon and library have other messages: use programs of one version. */
  FORETRACE_OTHER_VERSION = 6,
  /** Another program has the pen, the switch or the slot; the text names it. */
  FORETRACE_TAKEN = 7,
  /** The message is invalid (NaN, degrees, an unknown flag) and was not sent. */
  FORETRACE_INVALID = 8,
  /** It was not delivered, or nothing was heard in time. */
  FORETRACE_NOT_SENT = 9,
  /** The daemon or the gateway refused; the text is its reason. */
  FORETRACE_REFUSED = 10,
  /** Somebody else asked for the pen or the switch, and has it. */
  FORETRACE_HANDED_OVER = 11,
  /** The message is of before the machine's last start. */
  FORETRACE_OTHER_BOOT = 12,
  /** Files or memory of the instance cannot be used. */
  FORETRACE_INSTANCE = 13,
  /** A fault inside the library: please report it. */
  FORETRACE_INTERNAL = 14
};

/** What foretrace_renew found. */
enum foretrace_change {
  /** The same daemon still runs. */
  FORETRACE_UNCHANGED = 0,
  /** Another daemon took over: the handles work on. */
  FORETRACE_TAKEN_OVER = 1,
  /** Everything was made anew: close all handles but the attachment, and open them again. */
  FORETRACE_RENEWED = 2
};

/** Version of the library. */
const char *foretrace_version(void);
/** Text of the newest error of this thread; valid until the next one. Never null. */
const char *foretrace_last_error(void);
/** CLOCK_MONOTONIC [ns]. */
uint64_t foretrace_now_ns(void);

/* ---- attachment ---------------------------------------------------------------------------------------- */

/** foretrace_attach with the layout of the messages that the caller was built with. */
int foretrace_attach_as(uint64_t layout_hash, uint32_t instance, uint64_t wait_ns, foretrace_handle *out);

/** Attaches to the daemon of this user with this number, usually 0; waits so long for one to come up. */
static inline int foretrace_attach(uint32_t instance, uint64_t wait_ns, foretrace_handle *out) {
  return foretrace_attach_as(FORETRACE_LAYOUT_HASH, instance, wait_ns, out);
}

/** Closes whatever it is. What was opened from an attachment outlives it. */
int foretrace_close(foretrace_handle handle);
/** Whether a daemon is up at this moment. */
int foretrace_daemon_is_up(foretrace_handle attachment, bool *out);
/** Looks for a new daemon where the old one has ended (foretrace_change): once per second, or when no
 * messages come. FORETRACE_NO_DAEMON while there is none. */
int foretrace_renew(foretrace_handle attachment, uint32_t *change);

/* ---- the pen ------------------------------------------------------------------------------------------- */

/** The pen of this instance. name: shown to others, null for the program's own. take_over_ns: 0, or how long
 * to ask whoever holds it. */
int foretrace_pen(foretrace_handle attachment, const char *name, uint64_t take_over_ns, foretrace_handle *out);

/** Sends a sample: device_stamp_ns is when the pen was there and later than the one before, x_m and y_m are
 * metres in the tablet's plane, pressure -1 where unknown, flags of foretrace_pen_flags; the header is filled
 * in. heard (may be null): whether a daemon was connected. */
int foretrace_pen_send(foretrace_handle pen, const foretrace_pen_sample *sample, size_t size, bool *heard);
/** Gives way to whoever asked for the pen; writes who has it since, or an empty text. */
int foretrace_pen_handed_to(foretrace_handle pen, char *buffer, size_t room);

/** The same for programs of other users: through the socket of `foretrace gateway`. */
int foretrace_gateway(const char *path, foretrace_handle *out);
int foretrace_gateway_send(foretrace_handle gateway, const foretrace_pen_sample *sample, size_t size);
/** Ends the connection and closes the handle; writes how many samples were passed on and refused. */
int foretrace_gateway_finish(foretrace_handle gateway, char *buffer, size_t room);

/* ---- the arm ------------------------------------------------------------------------------------------- */

/** The joint commands from now on; buffer (1 to 256) are kept unread, 1 where only the newest counts. */
int foretrace_commands(foretrace_handle attachment, uint32_t buffer, foretrace_handle *out);
/** The newest command; all zero, which means brake, where there is none yet. there may be null. */
int foretrace_commands_latest(foretrace_handle commands, foretrace_joint_command *command, size_t size,
                              bool *there);
/** A joint state that echoes the newest command taken: fill in q, qd and the modes, and publish it. */
int foretrace_commands_echo(foretrace_handle commands, foretrace_joint_state *state, size_t size);

/** Evaluates a command: follow is true and q [rad], qd [rad/s] are what to do at now_ns, or false: brake to a
 * stand and stay. Where this fails it is false too. */
int foretrace_demand_at(const foretrace_joint_command *command, size_t size, uint64_t now_ns, double q[6],
                        double qd[6], bool *follow);

/** The place of the arm, from which joint states are sent. */
int foretrace_joint_states(foretrace_handle attachment, foretrace_handle *out);
/** Reports the arm as it was at measured_ns. The header is filled in. heard may be null. */
int foretrace_joint_states_publish(foretrace_handle states, uint64_t measured_ns,
                                   const foretrace_joint_state *state, size_t size, bool *heard);
/** Why the arm does not follow, and what an operator can do about it; why null: nothing keeps it. */
int foretrace_joint_states_note(foretrace_handle states, const char *why, const char *to_do);

/* ---- a predictor in a process of its own --------------------------------------------------------------- */

/** The steps of the pen's grid as they close, while predictor `external` is chosen. */
int foretrace_pen_steps(foretrace_handle attachment, foretrace_handle *out);
/** Waits for the next one; FORETRACE_NOT_SENT where none came in time. */
int foretrace_pen_steps_next(foretrace_handle steps, uint64_t timeout_ns, foretrace_pen_step *step, size_t size);

/** The predictor's place, from which previews are sent. */
int foretrace_previews(foretrace_handle attachment, foretrace_handle *out);
/** Sends where the pen will be: base_index of the step after which it predicts, count positions x_m, y_m [m],
 * the first one step later, at least `wanted` of that step; with FORETRACE_PREVIEW_RADII in flags, radius_m. The
 * header is filled in. What is wrong with the numbers the daemon counts, see `foretrace status`. heard may be
 * null. */
int foretrace_previews_send(foretrace_handle previews, const foretrace_pen_preview *preview, size_t size,
                            bool *heard);

/* ---- watching ------------------------------------------------------------------------------------------ */

/** The records of all ticks from now on: read at least twice per second. */
int foretrace_telemetry(foretrace_handle attachment, foretrace_handle *out);
/** Up to most unread records, oldest first; count says how many. size: of one record. */
int foretrace_telemetry_read(foretrace_handle telemetry, foretrace_tick_record *records, size_t size,
                             size_t most, size_t *count);
/** Records that never reached the caller. */
int foretrace_telemetry_lost(foretrace_handle telemetry, uint64_t *out);

/** The daemon's status, ten times per second and on every change. */
int foretrace_status_reader(foretrace_handle attachment, foretrace_handle *out);
/** Waits for the next one; FORETRACE_NOT_SENT where none came in time. */
int foretrace_status_next(foretrace_handle reader, uint64_t timeout_ns, foretrace_status *status, size_t size);

/* ---- asking -------------------------------------------------------------------------------------------- */

/** Asks the daemon (foretrace_control_op). value: of SET_TRUST, 0 to 1. predictor: of SWITCH_PREDICTOR, else
 * null. response may be null. */
int foretrace_request(foretrace_handle attachment, uint32_t operation, double value, const char *predictor,
                      uint64_t timeout_ns, foretrace_control_response *response, size_t size);

/** Stops the arm and keeps it stopped: needs no attachment, no shared memory and no free slot. Writes the
 * mode after it; buffer may be null. */
int foretrace_stop(uint32_t instance, uint64_t timeout_ns, char *buffer, size_t room);

/** The dead-man switch: beat every 20 ms while a hand holds it. Silence, foretrace_dead_man_stop and
 * foretrace_close stop the arm. */
int foretrace_dead_man(foretrace_handle attachment, const char *name, uint64_t take_over_ns,
                       foretrace_handle *out);
int foretrace_dead_man_beat(foretrace_handle dead_man);
int foretrace_dead_man_stop(foretrace_handle dead_man);

#ifdef __cplusplus
}
#endif

#endif
