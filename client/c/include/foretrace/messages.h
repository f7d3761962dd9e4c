/* Messages of foretrace. Made by `foretrace schema c`; do not edit. Lengths are metres, angles radians, times
 * nanoseconds of CLOCK_MONOTONIC. Enumerations and flags stand in fields of type uint32_t. */
#ifndef FORETRACE_MESSAGES_H
#define FORETRACE_MESSAGES_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#define FORETRACE_ASSERT(condition) static_assert(condition, #condition)
#else
#define FORETRACE_ASSERT(condition) _Static_assert(condition, #condition)
#endif

enum foretrace_mode {
  /** idle */
  FORETRACE_MODE_IDLE = 0,
  /** armed */
  FORETRACE_MODE_ARMED = 1,
  /** following */
  FORETRACE_MODE_FOLLOWING = 2,
  /** holding */
  FORETRACE_MODE_HOLDING = 3,
  /** stopped */
  FORETRACE_MODE_STOPPED = 4,
  /** fault */
  FORETRACE_MODE_FAULT = 5,
  /** moving home */
  FORETRACE_MODE_HOMING = 6,
};

static inline const char *foretrace_mode_label(int64_t number) {
  switch (number) {
  case 0: return "idle";
  case 1: return "armed";
  case 2: return "following";
  case 3: return "holding";
  case 4: return "stopped";
  case 5: return "fault";
  case 6: return "moving home";
  default: return "unknown";
  }
}

enum foretrace_rung {
  /** fresh plan */
  FORETRACE_RUNG_FRESH_PLAN = 0,
  /** previous plan */
  FORETRACE_RUNG_PREVIOUS_PLAN = 1,
  /** stop */
  FORETRACE_RUNG_STOP = 2,
  /** hold */
  FORETRACE_RUNG_HOLD = 3,
};

static inline const char *foretrace_rung_label(int64_t number) {
  switch (number) {
  case 0: return "fresh plan";
  case 1: return "previous plan";
  case 2: return "stop";
  case 3: return "hold";
  default: return "unknown";
  }
}

enum foretrace_trust_reason {
  /** inactive */
  FORETRACE_TRUST_REASON_INACTIVE = 0,
  /** warm-up */
  FORETRACE_TRUST_REASON_WARM_UP = 1,
  /** manual */
  FORETRACE_TRUST_REASON_MANUAL = 2,
  /** evidence */
  FORETRACE_TRUST_REASON_EVIDENCE = 3,
  /** hysteresis */
  FORETRACE_TRUST_REASON_HYSTERESIS = 4,
  /** pen stale */
  FORETRACE_TRUST_REASON_PEN_STALE = 6,
  /** pen jump */
  FORETRACE_TRUST_REASON_PEN_JUMP = 7,
  /** predictor unhealthy */
  FORETRACE_TRUST_REASON_PREDICTOR_UNHEALTHY = 9,
  /** predictor switched */
  FORETRACE_TRUST_REASON_PREDICTOR_SWITCHED = 10,
  /** worse than hold */
  FORETRACE_TRUST_REASON_WORSE_THAN_HOLD = 11,
  /** worse than constant velocity */
  FORETRACE_TRUST_REASON_WORSE_THAN_CONSTANT_VELOCITY = 12,
  /** frozen */
  FORETRACE_TRUST_REASON_FROZEN = 14,
  /** no evidence yet */
  FORETRACE_TRUST_REASON_UNPROVEN = 15,
  /** pen outside the bands */
  FORETRACE_TRUST_REASON_SURPRISED = 16,
  /** planner unhealthy */
  FORETRACE_TRUST_REASON_SOLVER_UNHEALTHY = 17,
  /** learner unhealthy */
  FORETRACE_TRUST_REASON_LEARNER_UNHEALTHY = 18,
  /** arm at its limits */
  FORETRACE_TRUST_REASON_ARM_LIMITED = 19,
};

static inline const char *foretrace_trust_reason_label(int64_t number) {
  switch (number) {
  case 0: return "inactive";
  case 1: return "warm-up";
  case 2: return "manual";
  case 3: return "evidence";
  case 4: return "hysteresis";
  case 6: return "pen stale";
  case 7: return "pen jump";
  case 9: return "predictor unhealthy";
  case 10: return "predictor switched";
  case 11: return "worse than hold";
  case 12: return "worse than constant velocity";
  case 14: return "frozen";
  case 15: return "no evidence yet";
  case 16: return "pen outside the bands";
  case 17: return "planner unhealthy";
  case 18: return "learner unhealthy";
  case 19: return "arm at its limits";
  default: return "unknown";
  }
}

enum foretrace_solver_path {
  /** not run */
  FORETRACE_SOLVER_PATH_NOT_RUN = 0,
  /** gain */
  FORETRACE_SOLVER_PATH_GAIN = 1,
  /** active set */
  FORETRACE_SOLVER_PATH_ACTIVE_SET = 2,
  /** clarabel */
  FORETRACE_SOLVER_PATH_CLARABEL = 3,
  /** fallback */
  FORETRACE_SOLVER_PATH_FALLBACK = 4,
};

static inline const char *foretrace_solver_path_label(int64_t number) {
  switch (number) {
  case 0: return "not run";
  case 1: return "gain";
  case 2: return "active set";
  case 3: return "clarabel";
  case 4: return "fallback";
  default: return "unknown";
  }
}

enum foretrace_fault_reason {
  /** none */
  FORETRACE_FAULT_REASON_NONE = 0,
  /** time lost */
  FORETRACE_FAULT_REASON_TIME_LOST = 1,
  /** joint state stale */
  FORETRACE_FAULT_REASON_JOINT_STATE_STALE = 2,
  /** robot stopped */
  FORETRACE_FAULT_REASON_ROBOT_STOPPED = 3,
  /** tracking error */
  FORETRACE_FAULT_REASON_TRACKING_ERROR = 4,
  /** dead-man */
  FORETRACE_FAULT_REASON_DEAD_MAN = 5,
  /** overruns */
  FORETRACE_FAULT_REASON_OVERRUNS = 8,
  /** internal */
  FORETRACE_FAULT_REASON_INTERNAL = 10,
  /** requested */
  FORETRACE_FAULT_REASON_REQUESTED = 11,
  /** tool envelope */
  FORETRACE_FAULT_REASON_ENVELOPE = 12,
  /** blocked while homing */
  FORETRACE_FAULT_REASON_WAY_BLOCKED = 13,
  /** contact */
  FORETRACE_FAULT_REASON_CONTACT = 14,
};

static inline const char *foretrace_fault_reason_label(int64_t number) {
  switch (number) {
  case 0: return "none";
  case 1: return "time lost";
  case 2: return "joint state stale";
  case 3: return "robot stopped";
  case 4: return "tracking error";
  case 5: return "dead-man";
  case 8: return "overruns";
  case 10: return "internal";
  case 11: return "requested";
  case 12: return "tool envelope";
  case 13: return "blocked while homing";
  case 14: return "contact";
  default: return "unknown";
  }
}

enum foretrace_stop_cause {
  /** none */
  FORETRACE_STOP_CAUSE_NONE = 0,
  /** joint deviation */
  FORETRACE_STOP_CAUSE_JOINT_DEVIATION = 1,
  /** tool deviation */
  FORETRACE_STOP_CAUSE_TOOL_DEVIATION = 2,
  /** wrong direction */
  FORETRACE_STOP_CAUSE_WRONG_DIRECTION = 3,
  /** no motion */
  FORETRACE_STOP_CAUSE_NO_MOTION = 4,
  /** runaway */
  FORETRACE_STOP_CAUSE_RUNAWAY = 5,
  /** growing oscillation */
  FORETRACE_STOP_CAUSE_OSCILLATION = 6,
  /** slow arm */
  FORETRACE_STOP_CAUSE_SLOW_ARM = 7,
  /** height over the paper */
  FORETRACE_STOP_CAUSE_HEIGHT = 8,
  /** workspace */
  FORETRACE_STOP_CAUSE_WORKSPACE = 9,
  /** tilt */
  FORETRACE_STOP_CAUSE_TILT = 10,
  /** tool speed */
  FORETRACE_STOP_CAUSE_TOOL_SPEED = 11,
  /** late ticks */
  FORETRACE_STOP_CAUSE_LATE_TICKS = 12,
  /** too near */
  FORETRACE_STOP_CAUSE_CLEARANCE = 13,
  /** response of a joint */
  FORETRACE_STOP_CAUSE_RESPONSE = 14,
  /** effort */
  FORETRACE_STOP_CAUSE_EFFORT = 15,
};

static inline const char *foretrace_stop_cause_label(int64_t number) {
  switch (number) {
  case 0: return "none";
  case 1: return "joint deviation";
  case 2: return "tool deviation";
  case 3: return "wrong direction";
  case 4: return "no motion";
  case 5: return "runaway";
  case 6: return "growing oscillation";
  case 7: return "slow arm";
  case 8: return "height over the paper";
  case 9: return "workspace";
  case 10: return "tilt";
  case 11: return "tool speed";
  case 12: return "late ticks";
  case 13: return "too near";
  case 14: return "response of a joint";
  case 15: return "effort";
  default: return "unknown";
  }
}

enum foretrace_safety_mode {
  /** unknown */
  FORETRACE_SAFETY_MODE_UNKNOWN = 0,
  /** normal */
  FORETRACE_SAFETY_MODE_NORMAL = 1,
  /** reduced */
  FORETRACE_SAFETY_MODE_REDUCED = 2,
  /** protective stop */
  FORETRACE_SAFETY_MODE_PROTECTIVE_STOP = 3,
  /** recovery */
  FORETRACE_SAFETY_MODE_RECOVERY = 4,
  /** safeguard stop */
  FORETRACE_SAFETY_MODE_SAFEGUARD_STOP = 5,
  /** system emergency stop */
  FORETRACE_SAFETY_MODE_SYSTEM_EMERGENCY_STOP = 6,
  /** robot emergency stop */
  FORETRACE_SAFETY_MODE_ROBOT_EMERGENCY_STOP = 7,
  /** violation */
  FORETRACE_SAFETY_MODE_VIOLATION = 8,
  /** fault */
  FORETRACE_SAFETY_MODE_FAULT = 9,
  /** validate joint id */
  FORETRACE_SAFETY_MODE_VALIDATE_JOINT_ID = 10,
  /** undefined */
  FORETRACE_SAFETY_MODE_UNDEFINED = 11,
};

static inline const char *foretrace_safety_mode_label(int64_t number) {
  switch (number) {
  case 0: return "unknown";
  case 1: return "normal";
  case 2: return "reduced";
  case 3: return "protective stop";
  case 4: return "recovery";
  case 5: return "safeguard stop";
  case 6: return "system emergency stop";
  case 7: return "robot emergency stop";
  case 8: return "violation";
  case 9: return "fault";
  case 10: return "validate joint id";
  case 11: return "undefined";
  default: return "unknown";
  }
}

enum foretrace_robot_mode {
  /** no controller */
  FORETRACE_ROBOT_MODE_NO_CONTROLLER = 0,
  /** disconnected */
  FORETRACE_ROBOT_MODE_DISCONNECTED = 1,
  /** confirm safety */
  FORETRACE_ROBOT_MODE_CONFIRM_SAFETY = 2,
  /** booting */
  FORETRACE_ROBOT_MODE_BOOTING = 3,
  /** power off */
  FORETRACE_ROBOT_MODE_POWER_OFF = 4,
  /** power on */
  FORETRACE_ROBOT_MODE_POWER_ON = 5,
  /** idle */
  FORETRACE_ROBOT_MODE_IDLE = 6,
  /** backdrive */
  FORETRACE_ROBOT_MODE_BACKDRIVE = 7,
  /** running */
  FORETRACE_ROBOT_MODE_RUNNING = 8,
  /** updating firmware */
  FORETRACE_ROBOT_MODE_UPDATING_FIRMWARE = 9,
};

static inline const char *foretrace_robot_mode_label(int64_t number) {
  switch (number) {
  case 0: return "no controller";
  case 1: return "disconnected";
  case 2: return "confirm safety";
  case 3: return "booting";
  case 4: return "power off";
  case 5: return "power on";
  case 6: return "idle";
  case 7: return "backdrive";
  case 8: return "running";
  case 9: return "updating firmware";
  default: return "unknown";
  }
}

enum foretrace_effort_unit {
  /** none */
  FORETRACE_EFFORT_UNIT_NONE = 0,
  /** Nm */
  FORETRACE_EFFORT_UNIT_NEWTON_METRES = 1,
  /** A */
  FORETRACE_EFFORT_UNIT_AMPERES = 2,
  /** share of the limit */
  FORETRACE_EFFORT_UNIT_SHARE = 3,
};

static inline const char *foretrace_effort_unit_label(int64_t number) {
  switch (number) {
  case 0: return "none";
  case 1: return "Nm";
  case 2: return "A";
  case 3: return "share of the limit";
  default: return "unknown";
  }
}

enum foretrace_control_op {
  /** query */
  FORETRACE_CONTROL_OP_QUERY = 0,
  /** arm */
  FORETRACE_CONTROL_OP_ARM = 1,
  /** disarm */
  FORETRACE_CONTROL_OP_DISARM = 2,
  /** stop */
  FORETRACE_CONTROL_OP_STOP = 3,
  /** set-trust */
  FORETRACE_CONTROL_OP_SET_TRUST = 4,
  /** trust-auto */
  FORETRACE_CONTROL_OP_TRUST_AUTO = 5,
  /** switch-predictor */
  FORETRACE_CONTROL_OP_SWITCH_PREDICTOR = 6,
  /** reload */
  FORETRACE_CONTROL_OP_RELOAD = 7,
  /** freeze-trust */
  FORETRACE_CONTROL_OP_FREEZE_TRUST = 8,
  /** move-home */
  FORETRACE_CONTROL_OP_MOVE_HOME = 9,
};

static inline const char *foretrace_control_op_label(int64_t number) {
  switch (number) {
  case 0: return "query";
  case 1: return "arm";
  case 2: return "disarm";
  case 3: return "stop";
  case 4: return "set-trust";
  case 5: return "trust-auto";
  case 6: return "switch-predictor";
  case 7: return "reload";
  case 8: return "freeze-trust";
  case 9: return "move-home";
  default: return "unknown";
  }
}

enum foretrace_control_status {
  /** ok */
  FORETRACE_CONTROL_STATUS_OK = 0,
  /** accepted */
  FORETRACE_CONTROL_STATUS_ACCEPTED = 1,
  /** invalid request */
  FORETRACE_CONTROL_STATUS_INVALID = -1,
  /** foreign boot */
  FORETRACE_CONTROL_STATUS_FOREIGN_BOOT = -2,
  /** wrong mode */
  FORETRACE_CONTROL_STATUS_WRONG_MODE = -3,
  /** no joint state */
  FORETRACE_CONTROL_STATUS_NO_JOINT_STATE = -4,
  /** joint state stale */
  FORETRACE_CONTROL_STATUS_JOINT_STATE_STALE = -5,
  /** outside limits */
  FORETRACE_CONTROL_STATUS_OUTSIDE_LIMITS = -6,
  /** robot not ready */
  FORETRACE_CONTROL_STATUS_ROBOT_NOT_READY = -7,
  /** not enabled */
  FORETRACE_CONTROL_STATUS_NOT_ENABLED = -8,
  /** predictor unavailable */
  FORETRACE_CONTROL_STATUS_PREDICTOR_UNAVAILABLE = -9,
  /** settings rejected */
  FORETRACE_CONTROL_STATUS_SETTINGS_REJECTED = -10,
  /** needs restart */
  FORETRACE_CONTROL_STATUS_NEEDS_RESTART = -11,
  /** busy */
  FORETRACE_CONTROL_STATUS_BUSY = -12,
  /** internal error */
  FORETRACE_CONTROL_STATUS_INTERNAL = -13,
  /** unsupported */
  FORETRACE_CONTROL_STATUS_UNSUPPORTED = -14,
  /** jump refused */
  FORETRACE_CONTROL_STATUS_JUMP = -15,
  /** arm moves */
  FORETRACE_CONTROL_STATUS_ARM_MOVES = -16,
  /** tool outside workspace */
  FORETRACE_CONTROL_STATUS_TOOL_OUTSIDE_WORKSPACE = -17,
  /** tool not aligned */
  FORETRACE_CONTROL_STATUS_TOOL_NOT_ALIGNED = -18,
  /** arm does not follow */
  FORETRACE_CONTROL_STATUS_NOT_FOLLOWING = -19,
  /** superseded by a stop */
  FORETRACE_CONTROL_STATUS_STOP_CAME = -20,
  /** path home is blocked */
  FORETRACE_CONTROL_STATUS_WAY_BLOCKED = -21,
};

static inline const char *foretrace_control_status_label(int64_t number) {
  switch (number) {
  case 0: return "ok";
  case 1: return "accepted";
  case -1: return "invalid request";
  case -2: return "foreign boot";
  case -3: return "wrong mode";
  case -4: return "no joint state";
  case -5: return "joint state stale";
  case -6: return "outside limits";
  case -7: return "robot not ready";
  case -8: return "not enabled";
  case -9: return "predictor unavailable";
  case -10: return "settings rejected";
  case -11: return "needs restart";
  case -12: return "busy";
  case -13: return "internal error";
  case -14: return "unsupported";
  case -15: return "jump refused";
  case -16: return "arm moves";
  case -17: return "tool outside workspace";
  case -18: return "tool not aligned";
  case -19: return "arm does not follow";
  case -20: return "superseded by a stop";
  case -21: return "path home is blocked";
  default: return "unknown";
  }
}

enum foretrace_stage {
  /** wakeup */
  FORETRACE_STAGE_WAKEUP = 0,
  /** receive */
  FORETRACE_STAGE_RECEIVE = 1,
  /** pen */
  FORETRACE_STAGE_PEN = 2,
  /** predict */
  FORETRACE_STAGE_PREDICT = 3,
  /** trust */
  FORETRACE_STAGE_TRUST = 4,
  /** mpc */
  FORETRACE_STAGE_MPC = 5,
  /** ik */
  FORETRACE_STAGE_IK = 6,
  /** guard */
  FORETRACE_STAGE_GUARD = 7,
  /** send */
  FORETRACE_STAGE_SEND = 8,
  /** step */
  FORETRACE_STAGE_STEP = 9,
};

static inline const char *foretrace_stage_label(int64_t number) {
  switch (number) {
  case 0: return "wakeup";
  case 1: return "receive";
  case 2: return "pen";
  case 3: return "predict";
  case 4: return "trust";
  case 5: return "mpc";
  case 6: return "ik";
  case 7: return "guard";
  case 8: return "send";
  case 9: return "step";
  default: return "unknown";
  }
}

enum foretrace_reject_reason {
  /** not finite */
  FORETRACE_REJECT_REASON_NOT_FINITE = 0,
  /** out of range */
  FORETRACE_REJECT_REASON_OUT_OF_RANGE = 1,
  /** unknown enum */
  FORETRACE_REJECT_REASON_UNKNOWN_ENUM = 2,
  /** unknown flags */
  FORETRACE_REJECT_REASON_UNKNOWN_FLAGS = 3,
  /** foreign boot */
  FORETRACE_REJECT_REASON_FOREIGN_BOOT = 4,
  /** time backwards */
  FORETRACE_REJECT_REASON_TIME_BACKWARDS = 5,
  /** from the future */
  FORETRACE_REJECT_REASON_FROM_THE_FUTURE = 6,
  /** replayed */
  FORETRACE_REJECT_REASON_REPLAYED = 7,
  /** too old */
  FORETRACE_REJECT_REASON_TOO_OLD = 8,
};

static inline const char *foretrace_reject_reason_label(int64_t number) {
  switch (number) {
  case 0: return "not finite";
  case 1: return "out of range";
  case 2: return "unknown enum";
  case 3: return "unknown flags";
  case 4: return "foreign boot";
  case 5: return "time backwards";
  case 6: return "from the future";
  case 7: return "replayed";
  case 8: return "too old";
  default: return "unknown";
  }
}

enum foretrace_reject_field {
  /** another field */
  FORETRACE_REJECT_FIELD_OTHER = 0,
  /** q */
  FORETRACE_REJECT_FIELD_Q = 1,
  /** qd */
  FORETRACE_REJECT_FIELD_QD = 2,
  /** effort */
  FORETRACE_REJECT_FIELD_EFFORT = 3,
  /** safety_mode */
  FORETRACE_REJECT_FIELD_SAFETY_MODE = 4,
  /** robot_mode */
  FORETRACE_REJECT_FIELD_ROBOT_MODE = 5,
  /** x_m */
  FORETRACE_REJECT_FIELD_X = 6,
  /** y_m */
  FORETRACE_REJECT_FIELD_Y = 7,
  /** pressure */
  FORETRACE_REJECT_FIELD_PRESSURE = 8,
  /** tilt_x_rad */
  FORETRACE_REJECT_FIELD_TILT_X = 9,
  /** tilt_y_rad */
  FORETRACE_REJECT_FIELD_TILT_Y = 10,
  /** flags */
  FORETRACE_REJECT_FIELD_FLAGS = 11,
  /** stamp_ns */
  FORETRACE_REJECT_FIELD_STAMP = 12,
  /** sequence */
  FORETRACE_REJECT_FIELD_SEQUENCE = 13,
  /** boot_id */
  FORETRACE_REJECT_FIELD_BOOT = 14,
  /** device_stamp_ns */
  FORETRACE_REJECT_FIELD_DEVICE_STAMP = 15,
  /** command_tick */
  FORETRACE_REJECT_FIELD_COMMAND_TICK = 16,
  /** pen_sequence */
  FORETRACE_REJECT_FIELD_PEN_SEQUENCE = 17,
  /** command_accepted_ns */
  FORETRACE_REJECT_FIELD_COMMAND_ACCEPTED = 18,
  /** effort_unit */
  FORETRACE_REJECT_FIELD_EFFORT_UNIT = 19,
};

static inline const char *foretrace_reject_field_label(int64_t number) {
  switch (number) {
  case 0: return "another field";
  case 1: return "q";
  case 2: return "qd";
  case 3: return "effort";
  case 4: return "safety_mode";
  case 5: return "robot_mode";
  case 6: return "x_m";
  case 7: return "y_m";
  case 8: return "pressure";
  case 9: return "tilt_x_rad";
  case 10: return "tilt_y_rad";
  case 11: return "flags";
  case 12: return "stamp_ns";
  case 13: return "sequence";
  case 14: return "boot_id";
  case 15: return "device_stamp_ns";
  case 16: return "command_tick";
  case 17: return "pen_sequence";
  case 18: return "command_accepted_ns";
  case 19: return "effort_unit";
  default: return "unknown";
  }
}

enum foretrace_ghost_state {
  /** off */
  FORETRACE_GHOST_STATE_OFF = 0,
  /** approaching */
  FORETRACE_GHOST_STATE_APPROACHING = 1,
  /** settling */
  FORETRACE_GHOST_STATE_SETTLING = 2,
  /** comparable */
  FORETRACE_GHOST_STATE_COMPARABLE = 3,
};

static inline const char *foretrace_ghost_state_label(int64_t number) {
  switch (number) {
  case 0: return "off";
  case 1: return "approaching";
  case 2: return "settling";
  case 3: return "comparable";
  default: return "unknown";
  }
}

enum foretrace_pen_motion {
  /** start */
  FORETRACE_PEN_MOTION_START = 0,
  /** continues */
  FORETRACE_PEN_MOTION_CONTINUES = 1,
  /** jump */
  FORETRACE_PEN_MOTION_JUMP = 2,
};

static inline const char *foretrace_pen_motion_label(int64_t number) {
  switch (number) {
  case 0: return "start";
  case 1: return "continues";
  case 2: return "jump";
  default: return "unknown";
  }
}

enum foretrace_preview_refusal {
  /** none */
  FORETRACE_PREVIEW_REFUSAL_NONE = 0,
  /** malformed */
  FORETRACE_PREVIEW_REFUSAL_MALFORMED = 1,
  /** non-finite */
  FORETRACE_PREVIEW_REFUSAL_NON_FINITE = 2,
  /** ahead */
  FORETRACE_PREVIEW_REFUSAL_AHEAD = 3,
  /** late */
  FORETRACE_PREVIEW_REFUSAL_LATE = 4,
  /** repeated */
  FORETRACE_PREVIEW_REFUSAL_REPEATED = 5,
  /** other stroke */
  FORETRACE_PREVIEW_REFUSAL_OTHER_STROKE = 6,
  /** wild */
  FORETRACE_PREVIEW_REFUSAL_WILD = 7,
  /** message */
  FORETRACE_PREVIEW_REFUSAL_MESSAGE = 8,
};

static inline const char *foretrace_preview_refusal_label(int64_t number) {
  switch (number) {
  case 0: return "none";
  case 1: return "malformed";
  case 2: return "non-finite";
  case 3: return "ahead";
  case 4: return "late";
  case 5: return "repeated";
  case 6: return "other stroke";
  case 7: return "wild";
  case 8: return "message";
  default: return "unknown";
  }
}

/* foretrace_pen_flags */
#define FORETRACE_PEN_CONTACT UINT32_C(0x1)
#define FORETRACE_PEN_IN_RANGE UINT32_C(0x2)
#define FORETRACE_PEN_BUTTON_1 UINT32_C(0x4)
#define FORETRACE_PEN_BUTTON_2 UINT32_C(0x8)
#define FORETRACE_PEN_BUTTON_3 UINT32_C(0x10)
#define FORETRACE_PEN_ERASER UINT32_C(0x20)
#define FORETRACE_PEN_SYNTHETIC UINT32_C(0x40)

/* foretrace_command_flags */
#define FORETRACE_COMMAND_ENABLED UINT32_C(0x1)
#define FORETRACE_COMMAND_BEGINS UINT32_C(0x2)
#define FORETRACE_COMMAND_STOPPING UINT32_C(0x4)

/* foretrace_arm_flags */
#define FORETRACE_ARM_WITHOUT_DEAD_MAN UINT32_C(0x1)
#define FORETRACE_ARM_SIMULATED UINT32_C(0x2)

/* foretrace_guard_mask */
#define FORETRACE_GUARD_MASK_NOT_FINITE UINT32_C(0x1)
#define FORETRACE_GUARD_MASK_POSITION UINT32_C(0x2)
#define FORETRACE_GUARD_MASK_VELOCITY UINT32_C(0x4)
#define FORETRACE_GUARD_MASK_ACCELERATION UINT32_C(0x8)
#define FORETRACE_GUARD_MASK_JERK UINT32_C(0x10)
#define FORETRACE_GUARD_MASK_DISCONTINUOUS UINT32_C(0x20)
#define FORETRACE_GUARD_MASK_UNSTOPPABLE UINT32_C(0x40)
#define FORETRACE_GUARD_MASK_GAP UINT32_C(0x80)

/* foretrace_health */
#define FORETRACE_HEALTH_PEN_STALE UINT32_C(0x1)
#define FORETRACE_HEALTH_PEN_GAP UINT32_C(0x2)
#define FORETRACE_HEALTH_PEN_JUMP UINT32_C(0x4)
#define FORETRACE_HEALTH_PEN_DISORDER UINT32_C(0x8)
#define FORETRACE_HEALTH_PEN_REJECTED UINT32_C(0x10)
#define FORETRACE_HEALTH_PREDICTOR_UNHEALTHY UINT32_C(0x20)
#define FORETRACE_HEALTH_PREVIEW_CLAMPED UINT32_C(0x40)
#define FORETRACE_HEALTH_WORKSPACE_CLAMPED UINT32_C(0x80)
#define FORETRACE_HEALTH_SOFT_LIMIT UINT32_C(0x100)
#define FORETRACE_HEALTH_MPC_CAP UINT32_C(0x200)
#define FORETRACE_HEALTH_MPC_FALLBACK UINT32_C(0x400)
#define FORETRACE_HEALTH_IK_CAP UINT32_C(0x800)
#define FORETRACE_HEALTH_NEAR_SINGULAR UINT32_C(0x1000)
#define FORETRACE_HEALTH_IK_CLIPPED UINT32_C(0x2000)
#define FORETRACE_HEALTH_GUARD_CLIPPED UINT32_C(0x4000)
#define FORETRACE_HEALTH_GUARD_REFUSED UINT32_C(0x8000)
#define FORETRACE_HEALTH_JOINT_STATE_STALE UINT32_C(0x10000)
#define FORETRACE_HEALTH_TIME_LOST UINT32_C(0x20000)
#define FORETRACE_HEALTH_RESYNCHRONISED UINT32_C(0x40000)
#define FORETRACE_HEALTH_SHED UINT32_C(0x80000)
#define FORETRACE_HEALTH_OVERRUN UINT32_C(0x100000)
#define FORETRACE_HEALTH_WEIGHTS_REFUSED UINT32_C(0x200000)
#define FORETRACE_HEALTH_LEARNER_RING_FULL UINT32_C(0x400000)
#define FORETRACE_HEALTH_TELEMETRY_RING_FULL UINT32_C(0x800000)
#define FORETRACE_HEALTH_NOT_FINITE UINT32_C(0x1000000)
#define FORETRACE_HEALTH_ROBOT_NOT_READY UINT32_C(0x2000000)
#define FORETRACE_HEALTH_COMMAND_NOT_SENT UINT32_C(0x4000000)
#define FORETRACE_HEALTH_DEAD_MAN UINT32_C(0x8000000)
#define FORETRACE_HEALTH_ALLOCATED UINT32_C(0x10000000)
#define FORETRACE_HEALTH_IK_FAILED UINT32_C(0x20000000)
#define FORETRACE_HEALTH_CLEARANCE UINT32_C(0x40000000)
#define FORETRACE_HEALTH_STOP_OFF_PATH UINT32_C(0x80000000)

/* foretrace_missing_rights */
#define FORETRACE_MISSING_RIGHTS_FIFO UINT32_C(0x1)
#define FORETRACE_MISSING_RIGHTS_MEMORY_LOCK UINT32_C(0x2)
#define FORETRACE_MISSING_RIGHTS_AFFINITY UINT32_C(0x4)
#define FORETRACE_MISSING_RIGHTS_CPU_LATENCY UINT32_C(0x8)
#define FORETRACE_MISSING_RIGHTS_TIMER_SLACK UINT32_C(0x10)
#define FORETRACE_MISSING_RIGHTS_PREEMPT_RT UINT32_C(0x20)
#define FORETRACE_MISSING_RIGHTS_SHARED_MEMORY_RESERVED UINT32_C(0x40)
#define FORETRACE_MISSING_RIGHTS_NOT_ASKED UINT32_C(0x80)

/* foretrace_preview_flags */
#define FORETRACE_PREVIEW_RADII UINT32_C(0x1)

/** First field of every message. */
typedef struct foretrace_header {
  /** Sequence number of the message of its publisher, from 1. */
  uint64_t sequence;
  /** Monotonic clock [ns]: when it was sent, except for commands (see JointCommand). */
  uint64_t stamp_ns;
  /** The sender's host_boot_id(). */
  uint64_t boot_id;
} foretrace_header;
FORETRACE_ASSERT(sizeof(foretrace_header) == 24);
FORETRACE_ASSERT(offsetof(foretrace_header, sequence) == 0);
FORETRACE_ASSERT(offsetof(foretrace_header, stamp_ns) == 8);
FORETRACE_ASSERT(offsetof(foretrace_header, boot_id) == 16);

/** One reading of the pen. Positions are in metres in the device's plane, x right, y away from the writer. */
typedef struct foretrace_pen_sample {
  /** Stamp: when it was sent. */
  foretrace_header header;
  /** When the pen was there [ns], mapped by the reader to this host's monotonic clock. */
  uint64_t device_stamp_ns;
  /** Position [m]. */
  double x_m;
  /** Position [m]. */
  double y_m;
  /** 0 to 1; negative: unknown. */
  float pressure;
  /** Tilt towards x from the plane's normal [rad]. */
  float tilt_x_rad;
  /** Tilt towards y from the plane's normal [rad]. */
  float tilt_y_rad;
  /** pen_flags. */
  uint32_t flags;
} foretrace_pen_sample;
FORETRACE_ASSERT(sizeof(foretrace_pen_sample) == 64);
FORETRACE_ASSERT(offsetof(foretrace_pen_sample, header) == 0);
FORETRACE_ASSERT(offsetof(foretrace_pen_sample, device_stamp_ns) == 24);
FORETRACE_ASSERT(offsetof(foretrace_pen_sample, x_m) == 32);
FORETRACE_ASSERT(offsetof(foretrace_pen_sample, y_m) == 40);
FORETRACE_ASSERT(offsetof(foretrace_pen_sample, pressure) == 48);
FORETRACE_ASSERT(offsetof(foretrace_pen_sample, tilt_x_rad) == 52);
FORETRACE_ASSERT(offsetof(foretrace_pen_sample, tilt_y_rad) == 56);
FORETRACE_ASSERT(offsetof(foretrace_pen_sample, flags) == 60);

/** Joint positions to be reached at header.stamp_ns, one control period after the tick that made them. */
typedef struct foretrace_joint_command {
  /** Stamp: the time at which q holds; up to one period in the future. */
  foretrace_header header;
  /** When it was sent [ns]. */
  uint64_t published_ns;
  /** The tick that made it. */
  uint64_t tick;
  /** The consumer brakes from this time on [ns]. */
  uint64_t valid_until_ns;
  /** Identity of the newest pen sample behind it: its number in its publisher's sequence; 0: none. */
  uint64_t pen_sequence;
  /** Identity of the newest pen sample behind it: its device stamp [ns]; 0: none. */
  uint64_t pen_stamp_ns;
  /** Joint positions at the stamp [rad]. */
  double q[6];
  /** Joint velocities up to the stamp [rad/s]. */
  double qd[6];
  /** Mode. */
  uint32_t mode;
  /** command_flags. */
  uint32_t flags;
} foretrace_joint_command;
FORETRACE_ASSERT(sizeof(foretrace_joint_command) == 168);
FORETRACE_ASSERT(offsetof(foretrace_joint_command, header) == 0);
FORETRACE_ASSERT(offsetof(foretrace_joint_command, published_ns) == 24);
FORETRACE_ASSERT(offsetof(foretrace_joint_command, tick) == 32);
FORETRACE_ASSERT(offsetof(foretrace_joint_command, valid_until_ns) == 40);
FORETRACE_ASSERT(offsetof(foretrace_joint_command, pen_sequence) == 48);
FORETRACE_ASSERT(offsetof(foretrace_joint_command, pen_stamp_ns) == 56);
FORETRACE_ASSERT(offsetof(foretrace_joint_command, q) == 64);
FORETRACE_ASSERT(offsetof(foretrace_joint_command, qd) == 112);
FORETRACE_ASSERT(offsetof(foretrace_joint_command, mode) == 160);
FORETRACE_ASSERT(offsetof(foretrace_joint_command, flags) == 164);

/** The line between an arm's process and the arm's own controller. All zero where there is none. */
typedef struct foretrace_arm_line {
  /** From a state of the arm to the cycle of its controller that used the answer to it [ns]; 0: unknown. */
  uint64_t round_trip_ns;
  /** Cycles of the controller that had no fresh command, while the arm followed. */
  uint64_t late_cycles;
  /** Commands that the controller never saw, because a newer one came within the same cycle. */
  uint64_t lost_commands;
  /** crate.arm_flags. */
  uint32_t flags;
  /** Zero. */
  uint32_t reserved;
} foretrace_arm_line;
FORETRACE_ASSERT(sizeof(foretrace_arm_line) == 32);
FORETRACE_ASSERT(offsetof(foretrace_arm_line, round_trip_ns) == 0);
FORETRACE_ASSERT(offsetof(foretrace_arm_line, late_cycles) == 8);
FORETRACE_ASSERT(offsetof(foretrace_arm_line, lost_commands) == 16);
FORETRACE_ASSERT(offsetof(foretrace_arm_line, flags) == 24);
FORETRACE_ASSERT(offsetof(foretrace_arm_line, reserved) == 28);

/** Measured state of the arm. */
typedef struct foretrace_joint_state {
  /** Stamp: when it was measured, on this host's clock. */
  foretrace_header header;
  /** The robot's own clock [ns]; 0: none. */
  uint64_t robot_stamp_ns;
  /** Tick of the newest command accepted; 0: none. This and the next three are filled in by echo. */
  uint64_t command_tick;
  /** When that command was accepted, on this host's clock [ns]; 0: unknown. */
  uint64_t command_accepted_ns;
  /** pen_sequence of that command. */
  uint64_t pen_sequence;
  /** pen_stamp_ns of that command. */
  uint64_t pen_stamp_ns;
  /** Commands accepted so far. */
  uint64_t commands_received;
  /** Commands refused so far (stale, foreign, malformed). */
  uint64_t commands_refused;
  /** Joint positions [rad]. */
  double q[6];
  /** Joint velocities [rad/s]. */
  double qd[6];
  /** Joint currents or torques, positive along each joint's axis, in effort_unit. */
  double effort[6];
  /** SafetyMode. */
  uint32_t safety_mode;
  /** RobotMode. */
  uint32_t robot_mode;
  /** EffortUnit; 0: the arm reports no effort. */
  uint32_t effort_unit;
  /** Number of the crate.ArmNote that is in force; 0: none. */
  uint32_t note;
  /** The line to the arm's controller. */
  foretrace_arm_line line;
} foretrace_joint_state;
FORETRACE_ASSERT(sizeof(foretrace_joint_state) == 272);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, header) == 0);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, robot_stamp_ns) == 24);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, command_tick) == 32);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, command_accepted_ns) == 40);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, pen_sequence) == 48);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, pen_stamp_ns) == 56);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, commands_received) == 64);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, commands_refused) == 72);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, q) == 80);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, qd) == 128);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, effort) == 176);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, safety_mode) == 224);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, robot_mode) == 228);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, effort_unit) == 232);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, note) == 236);
FORETRACE_ASSERT(offsetof(foretrace_joint_state, line) == 240);

/** The latency from pen to arm in parts [ns]; u64.MAX: unknown.  Not to be summed: a command is stamped one control period after its tick, so compute and transport within that period delay nothing. The arm's own lag, from a command's stamp to the motion, is separate. */
typedef struct foretrace_chain {
  /** Device stamp to sent, of the newest pen sample: time of the device and its reader. */
  uint64_t pen_reader_ns;
  /** Sent to received by a tick, of the newest pen sample: shared memory, and waiting for the tick. */
  uint64_t pen_transport_ns;
  /** Device stamp of the newest pen sample to the release of the tick. */
  uint64_t pen_age_ns;
  /** Start of the tick to the command handed to the middleware. */
  uint64_t compute_ns;
  /** Handed to the middleware to accepted by the arm, of the newest command that the arm has echoed. */
  uint64_t command_transport_ns;
} foretrace_chain;
FORETRACE_ASSERT(sizeof(foretrace_chain) == 40);
FORETRACE_ASSERT(offsetof(foretrace_chain, pen_reader_ns) == 0);
FORETRACE_ASSERT(offsetof(foretrace_chain, pen_transport_ns) == 8);
FORETRACE_ASSERT(offsetof(foretrace_chain, pen_age_ns) == 16);
FORETRACE_ASSERT(offsetof(foretrace_chain, compute_ns) == 24);
FORETRACE_ASSERT(offsetof(foretrace_chain, command_transport_ns) == 32);

/** A predictor's name, or none. */
typedef struct foretrace_predictor_name {
  /** ASCII, padded with NUL. */
  uint8_t bytes[28];
} foretrace_predictor_name;
FORETRACE_ASSERT(sizeof(foretrace_predictor_name) == 28);
FORETRACE_ASSERT(offsetof(foretrace_predictor_name, bytes) == 0);

/** Refusals by reason, indexed by RejectReason. */
typedef struct foretrace_rejections {
  /** One counter per reason. */
  uint64_t by_reason[9];
} foretrace_rejections;
FORETRACE_ASSERT(sizeof(foretrace_rejections) == 72);
FORETRACE_ASSERT(offsetof(foretrace_rejections, by_reason) == 0);

/** Totals since the daemon started. */
typedef struct foretrace_counters {
  /** Ticks run. */
  uint64_t ticks;
  /** Ticks that ended after their deadline. */
  uint64_t overruns;
  /** Whole periods dropped. */
  uint64_t skipped_ticks;
  /** Ticks run with a shed budget. */
  uint64_t shed_ticks;
  /** Commands published. */
  uint64_t commands_sent;
  /** Commands that could not be published. */
  uint64_t commands_failed;
  /** Pen samples accepted. */
  uint64_t pen_received;
  /** Pen samples missing in the sender's sequence. */
  uint64_t pen_dropped;
  /** Pen samples whose device stamp went backwards or repeated. */
  uint64_t pen_out_of_order;
  /** Pen samples accepted, but set aside as jump or outlier. */
  uint64_t pen_outliers;
  /** Gaps in the pen's device stamps. */
  uint64_t pen_gaps;
  /** Ticks that left pen samples for the next one, because a tick takes a bounded number. */
  uint64_t pen_deferred_ticks;
  /** Pen samples refused, by reason. */
  foretrace_rejections pen_rejected;
  /** Joint states accepted. */
  uint64_t joint_state_received;
  /** Joint states missing in the sender's sequence. */
  uint64_t joint_state_dropped;
  /** Ticks whose newest joint state was stale. */
  uint64_t joint_state_stale;
  /** Joint states refused, by reason. */
  foretrace_rejections joint_state_rejected;
  /** Dead-man messages refused, all reasons. */
  uint64_t enable_rejected;
  /** Dead-man messages missing in the sender's sequence. */
  uint64_t enable_dropped;
  /** Errors of the middleware while receiving. */
  uint64_t receive_failures;
  /** Tick records lost because the ring to the ipc thread was full. */
  uint64_t telemetry_ring_dropped;
  /** Tick records that could not be published. */
  uint64_t telemetry_failed;
  /** Grid steps lost because the learner's ring was full. */
  uint64_t learner_ring_dropped;
  /** Sets of weights refused by the loop. */
  uint64_t weights_refused;
  /** Sets of weights that a newer set overtook before the loop took them up. */
  uint64_t weights_overtaken;
  /** Events of the learner lost because its channel was full. */
  uint64_t learner_events_lost;
  /** Requests answered. */
  uint64_t requests;
  /** Requests answered with a refusal. */
  uint64_t requests_refused;
  /** Heap allocations on the real-time thread after warm-up, except in ticks with a connection change. */
  uint64_t allocations;
  /** Heap allocations in ticks in which a port connected or disconnected. */
  uint64_t connection_allocations;
  /** Ticks in which a port connected or disconnected. */
  uint64_t connection_ticks;
  /** Minor page faults of the real-time thread. */
  uint64_t page_faults_minor;
  /** Major page faults of the real-time thread. */
  uint64_t page_faults_major;
} foretrace_counters;
FORETRACE_ASSERT(sizeof(foretrace_counters) == 392);
FORETRACE_ASSERT(offsetof(foretrace_counters, ticks) == 0);
FORETRACE_ASSERT(offsetof(foretrace_counters, overruns) == 8);
FORETRACE_ASSERT(offsetof(foretrace_counters, skipped_ticks) == 16);
FORETRACE_ASSERT(offsetof(foretrace_counters, shed_ticks) == 24);
FORETRACE_ASSERT(offsetof(foretrace_counters, commands_sent) == 32);
FORETRACE_ASSERT(offsetof(foretrace_counters, commands_failed) == 40);
FORETRACE_ASSERT(offsetof(foretrace_counters, pen_received) == 48);
FORETRACE_ASSERT(offsetof(foretrace_counters, pen_dropped) == 56);
FORETRACE_ASSERT(offsetof(foretrace_counters, pen_out_of_order) == 64);
FORETRACE_ASSERT(offsetof(foretrace_counters, pen_outliers) == 72);
FORETRACE_ASSERT(offsetof(foretrace_counters, pen_gaps) == 80);
FORETRACE_ASSERT(offsetof(foretrace_counters, pen_deferred_ticks) == 88);
FORETRACE_ASSERT(offsetof(foretrace_counters, pen_rejected) == 96);
FORETRACE_ASSERT(offsetof(foretrace_counters, joint_state_received) == 168);
FORETRACE_ASSERT(offsetof(foretrace_counters, joint_state_dropped) == 176);
FORETRACE_ASSERT(offsetof(foretrace_counters, joint_state_stale) == 184);
FORETRACE_ASSERT(offsetof(foretrace_counters, joint_state_rejected) == 192);
FORETRACE_ASSERT(offsetof(foretrace_counters, enable_rejected) == 264);
FORETRACE_ASSERT(offsetof(foretrace_counters, enable_dropped) == 272);
FORETRACE_ASSERT(offsetof(foretrace_counters, receive_failures) == 280);
FORETRACE_ASSERT(offsetof(foretrace_counters, telemetry_ring_dropped) == 288);
FORETRACE_ASSERT(offsetof(foretrace_counters, telemetry_failed) == 296);
FORETRACE_ASSERT(offsetof(foretrace_counters, learner_ring_dropped) == 304);
FORETRACE_ASSERT(offsetof(foretrace_counters, weights_refused) == 312);
FORETRACE_ASSERT(offsetof(foretrace_counters, weights_overtaken) == 320);
FORETRACE_ASSERT(offsetof(foretrace_counters, learner_events_lost) == 328);
FORETRACE_ASSERT(offsetof(foretrace_counters, requests) == 336);
FORETRACE_ASSERT(offsetof(foretrace_counters, requests_refused) == 344);
FORETRACE_ASSERT(offsetof(foretrace_counters, allocations) == 352);
FORETRACE_ASSERT(offsetof(foretrace_counters, connection_allocations) == 360);
FORETRACE_ASSERT(offsetof(foretrace_counters, connection_ticks) == 368);
FORETRACE_ASSERT(offsetof(foretrace_counters, page_faults_minor) == 376);
FORETRACE_ASSERT(offsetof(foretrace_counters, page_faults_major) == 384);

/** The arm's lag from a command's stamp to the motion, measured in normal operation. */
typedef struct foretrace_arm_lag {
  /** Dead time by which the plan looks ahead [ns]. */
  uint64_t dead_time_ns;
  /** Group delay at low frequency [s]. */
  double lag_s;
  /** Its standard deviation [s]; negative: the lag is unknown, and the fields beside it are meaningless. */
  double std_s;
  /** Shift of the commands that fits the recent motion best [s]; shorter than the group delay if the arm is a filter. */
  double shift_s;
} foretrace_arm_lag;
FORETRACE_ASSERT(sizeof(foretrace_arm_lag) == 32);
FORETRACE_ASSERT(offsetof(foretrace_arm_lag, dead_time_ns) == 0);
FORETRACE_ASSERT(offsetof(foretrace_arm_lag, lag_s) == 8);
FORETRACE_ASSERT(offsetof(foretrace_arm_lag, std_s) == 16);
FORETRACE_ASSERT(offsetof(foretrace_arm_lag, shift_s) == 24);

/** Evidence behind a latched stop: which joint, how much, and the limit that was broken. */
typedef struct foretrace_stop_detail {
  /** StopCause, which determines the unit of amount and limit. */
  uint32_t cause;
  /** Joint index from 0, base first; −1: the tool, or no joint. */
  int32_t joint;
  /** Observed value. */
  double amount;
  /** Allowed value. */
  double limit;
  /** Release of the tick in which the stop latched [ns]; 0: no stop has latched. */
  uint64_t at_ns;
} foretrace_stop_detail;
FORETRACE_ASSERT(sizeof(foretrace_stop_detail) == 32);
FORETRACE_ASSERT(offsetof(foretrace_stop_detail, cause) == 0);
FORETRACE_ASSERT(offsetof(foretrace_stop_detail, joint) == 4);
FORETRACE_ASSERT(offsetof(foretrace_stop_detail, amount) == 8);
FORETRACE_ASSERT(offsetof(foretrace_stop_detail, limit) == 16);
FORETRACE_ASSERT(offsetof(foretrace_stop_detail, at_ns) == 24);

/** One tick's evidence. */
typedef struct foretrace_tick_record {
  /** Stamp: end of the tick. */
  foretrace_header header;
  /** Number of the tick, from 1. */
  uint64_t tick;
  /** When it should have started [ns]. */
  uint64_t release_ns;
  /** The time at which its command holds [ns]. */
  uint64_t command_stamp_ns;
  /** Time left to the deadline [ns]; negative after an overrun. */
  int64_t slack_ns;
  /** Cost of each Stage [ns], saturated. */
  uint32_t stage_ns[10];
  /** Caps of iterations the tick was given: MPC. */
  uint32_t budget_mpc_iterations;
  /** Caps of iterations the tick was given: IK. */
  uint32_t budget_ik_iterations;
  /** 1: the budget was shed. */
  uint32_t shed;
  /** Whole periods dropped before this tick. */
  uint32_t skipped_ticks;
  /** Identity of the newest pen sample: its number in its publisher's sequence; 0: none yet. */
  uint64_t pen_sequence;
  /** Identity of the newest pen sample: its device stamp [ns]; 0: none yet. */
  uint64_t pen_stamp_ns;
  /** Latencies, part by part. */
  foretrace_chain chain;
  /** Newest pen position [m]. */
  double pen_m[3];
  /** Pen samples accepted in this tick. */
  uint32_t pen_samples;
  /** crate.pen_flags of the newest sample. */
  uint32_t pen_flags;
  /** Age of the newest joint state [ns]. */
  uint64_t joint_state_age_ns;
  /** Newest measured joint positions [rad]. */
  double measured_q[6];
  /** Tick of the newest command that the arm has echoed; 0: none. */
  uint64_t echo_tick;
  /** Identity of the pen sample behind that command, as echoed: its number. */
  uint64_t echo_pen_sequence;
  /** Identity of the pen sample behind that command, as echoed: its device stamp [ns]. */
  uint64_t echo_pen_stamp_ns;
  /** Reference of the tool at the command's stamp [m]. */
  double reference_m[3];
  /** Setpoint: position [m]. */
  double setpoint_m[3];
  /** Setpoint: velocity [m/s]. */
  double setpoint_mps[3];
  /** Setpoint: acceleration [m/s²]. */
  double setpoint_mps2[3];
  /** Jerk of the setpoint since the tick before [m/s³]; 0 where that tick sent no command. */
  double jerk_mps3[3];
  /** Tool position of the published command [m]. */
  double tool_m[3];
  /** Published joint positions [rad]. */
  double q[6];
  /** Published joint velocities [rad/s]. */
  double qd[6];
  /** Trust α: 1 prediction only, 0 hold only. */
  double trust;
  /** Target of α. */
  double trust_target;
  /** Part of another process's predictor in the preview, [0, 1]; negative: it is not chosen. */
  double confidence;
  /** TrustReason. */
  uint32_t trust_reason;
  /** Rung. */
  uint32_t rung;
  /** Mode. */
  uint32_t mode;
  /** FaultReason. */
  uint32_t fault;
  /** health. */
  uint32_t health;
  /** guard_mask. */
  uint32_t guard_mask;
  /** Joints the guard altered, one bit per joint. */
  uint32_t guard_joints;
  /** Soft limits of the MPC exceeded, all axes. */
  uint32_t mpc_soft;
  /** Active limits of the MPC, per axis. */
  uint32_t mpc_active[3];
  /** Solver iterations, per axis. */
  uint32_t mpc_iterations[3];
  /** SolverPath, per axis. */
  uint32_t mpc_path[3];
  /** Joints at a limit in the IK, one bit per joint. */
  uint32_t ik_active;
  /** Solver iterations. */
  uint32_t ik_iterations;
  /** SolverPath. */
  uint32_t ik_path;
  /** KKT residual, normalised, per axis; negative: not computed. */
  double mpc_residual[3];
  /** KKT residual, normalised; negative: not computed. */
  double ik_residual;
  /** Length of the orientation error [rad]. */
  double orientation_error_rad;
  /** Distance to the nearest singularity [m]; negative: not computed. */
  double singularity_m;
  /** One-step error of the predictor at the newest closed grid step [m]; negative: none. */
  double predictor_error_m;
  /** Radius about the plan's first reference in which the pen is expected in nine of ten cases [m]; negative: unknown. */
  double predictor_band_m;
  /** Version of the weights in use. */
  uint64_t learner_version;
  /** Age of the weights in use [ns]. */
  uint64_t learner_age_ns;
  /** The active predictor. */
  foretrace_predictor_name predictor;
  /** Steps of the roll-out. */
  uint32_t preview_steps;
  /** Heap allocations in this tick. */
  uint32_t allocations;
  /** 1: a port connected or disconnected in this tick. */
  uint32_t connections_changed;
  /** Totals up to this tick. */
  foretrace_counters counters;
  /** The arm's lag, and the plan's dead time. */
  foretrace_arm_lag arm_lag;
  /** Tool position of the command at the same stamp at Hold (trust 0) [m]; zero without a ghost. */
  double ghost_tool_m[3];
  /** The time of the next two distances, a tenth of a second back [ns]; 0: none in this tick. */
  uint64_t compared_ns;
  /** Distance of the measured tool from the pen at that time, in the plane [m]; negative: none in this tick. */
  double error_m;
  /** The same for the ghost's tool, behind an arm of the same lag [m]; negative: none in this tick. */
  double ghost_error_m;
  /** GhostState. */
  uint32_t ghost_state;
  /** 1: the pen wrote at that time. */
  uint32_t compared_contact;
  /** Evidence behind the newest latched stop. */
  foretrace_stop_detail stop;
  /** Fraction of the commanded speed at which the arm moves; negative: unknown. */
  double arm_speed_share;
  /** The line to the arm's controller. */
  foretrace_arm_line arm_line;
  /** Points of the next field that are known; 0: there was no preview, or no plan. */
  uint32_t path_points;
  /** 0. */
  uint32_t reserved;
  /** The previewed path that the plan was to follow, as far as it trusted it: x and y of each point in turn, from soon to late, the plan's last reference at the end [m]. */
  float path_m[20];
} foretrace_tick_record;
FORETRACE_ASSERT(sizeof(foretrace_tick_record) == 1384);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, header) == 0);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, tick) == 24);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, release_ns) == 32);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, command_stamp_ns) == 40);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, slack_ns) == 48);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, stage_ns) == 56);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, budget_mpc_iterations) == 96);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, budget_ik_iterations) == 100);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, shed) == 104);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, skipped_ticks) == 108);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, pen_sequence) == 112);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, pen_stamp_ns) == 120);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, chain) == 128);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, pen_m) == 168);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, pen_samples) == 192);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, pen_flags) == 196);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, joint_state_age_ns) == 200);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, measured_q) == 208);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, echo_tick) == 256);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, echo_pen_sequence) == 264);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, echo_pen_stamp_ns) == 272);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, reference_m) == 280);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, setpoint_m) == 304);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, setpoint_mps) == 328);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, setpoint_mps2) == 352);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, jerk_mps3) == 376);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, tool_m) == 400);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, q) == 424);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, qd) == 472);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, trust) == 520);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, trust_target) == 528);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, confidence) == 536);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, trust_reason) == 544);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, rung) == 548);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, mode) == 552);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, fault) == 556);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, health) == 560);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, guard_mask) == 564);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, guard_joints) == 568);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, mpc_soft) == 572);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, mpc_active) == 576);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, mpc_iterations) == 588);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, mpc_path) == 600);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, ik_active) == 612);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, ik_iterations) == 616);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, ik_path) == 620);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, mpc_residual) == 624);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, ik_residual) == 648);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, orientation_error_rad) == 656);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, singularity_m) == 664);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, predictor_error_m) == 672);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, predictor_band_m) == 680);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, learner_version) == 688);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, learner_age_ns) == 696);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, predictor) == 704);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, preview_steps) == 732);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, allocations) == 736);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, connections_changed) == 740);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, counters) == 744);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, arm_lag) == 1136);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, ghost_tool_m) == 1168);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, compared_ns) == 1192);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, error_m) == 1200);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, ghost_error_m) == 1208);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, ghost_state) == 1216);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, compared_contact) == 1220);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, stop) == 1224);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, arm_speed_share) == 1256);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, arm_line) == 1264);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, path_points) == 1296);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, reserved) == 1300);
FORETRACE_ASSERT(offsetof(foretrace_tick_record, path_m) == 1304);

/** Distribution of a duration [ns], saturated. */
typedef struct foretrace_percentiles {
  /** Median. */
  uint32_t p50_ns;
  /** 99 of 100 are at most this. */
  uint32_t p99_ns;
  /** 999 of 1000 are at most this. */
  uint32_t p99_9_ns;
  /** The largest. */
  uint32_t max_ns;
} foretrace_percentiles;
FORETRACE_ASSERT(sizeof(foretrace_percentiles) == 16);
FORETRACE_ASSERT(offsetof(foretrace_percentiles, p50_ns) == 0);
FORETRACE_ASSERT(offsetof(foretrace_percentiles, p99_ns) == 4);
FORETRACE_ASSERT(offsetof(foretrace_percentiles, p99_9_ns) == 8);
FORETRACE_ASSERT(offsetof(foretrace_percentiles, max_ns) == 12);

/** Distribution of a latency since the daemon started, after warm-up. */
typedef struct foretrace_latency {
  /** Number of measurements. */
  uint64_t count;
  /** Percentiles, saturated at 4.29 s. */
  foretrace_percentiles percentiles;
  /** Counts of measurements below Latency.edge_us and not below the edge before; the last bin counts the rest, saturated. */
  uint32_t bins[20];
} foretrace_latency;
FORETRACE_ASSERT(sizeof(foretrace_latency) == 104);
FORETRACE_ASSERT(offsetof(foretrace_latency, count) == 0);
FORETRACE_ASSERT(offsetof(foretrace_latency, percentiles) == 8);
FORETRACE_ASSERT(offsetof(foretrace_latency, bins) == 24);

/** How well a tool follows the pen, since the loop was armed. Distances in the plane; negative: unknown. Lags are the shift of the pen that fits the tool best, −0.05 to 0.2; NaN: unknown. */
typedef struct foretrace_tracking {
  /** Root mean square distance while the pen writes, over the last seconds of writing [m]. */
  double recent_rms_m;
  /** The same since arming [m]. */
  double session_rms_m;
  /** The same since arming, hovering included [m]. */
  double hover_rms_m;
  /** Lag of the tool behind the pen, over the last seconds of writing [s]. */
  double recent_lag_s;
  /** The same since arming [s]. */
  double session_lag_s;
} foretrace_tracking;
FORETRACE_ASSERT(sizeof(foretrace_tracking) == 40);
FORETRACE_ASSERT(offsetof(foretrace_tracking, recent_rms_m) == 0);
FORETRACE_ASSERT(offsetof(foretrace_tracking, session_rms_m) == 8);
FORETRACE_ASSERT(offsetof(foretrace_tracking, hover_rms_m) == 16);
FORETRACE_ASSERT(offsetof(foretrace_tracking, recent_lag_s) == 24);
FORETRACE_ASSERT(offsetof(foretrace_tracking, session_lag_s) == 32);

/** Extremes of the measured tool since the daemon took charge, by forward kinematics of the *measured* joints in the plane's frame. NaN: not measured yet. */
typedef struct foretrace_tool_extent {
  /** Lowest height over the paper [m]. */
  double height_min_m;
  /** Greatest height over the paper [m]. */
  double height_max_m;
  /** Farthest outside the workspace in the plane, 0 inside [m]. */
  double outside_max_m;
  /** Largest angle between the tool's axis and the plane's normal [rad]. */
  double tilt_max_rad;
} foretrace_tool_extent;
FORETRACE_ASSERT(sizeof(foretrace_tool_extent) == 32);
FORETRACE_ASSERT(offsetof(foretrace_tool_extent, height_min_m) == 0);
FORETRACE_ASSERT(offsetof(foretrace_tool_extent, height_max_m) == 8);
FORETRACE_ASSERT(offsetof(foretrace_tool_extent, outside_max_m) == 16);
FORETRACE_ASSERT(offsetof(foretrace_tool_extent, tilt_max_rad) == 24);

/** The newest refusal of one kind of message. */
typedef struct foretrace_refused {
  /** RejectReason. */
  uint32_t reason;
  /** RejectField. */
  uint32_t field;
  /** Element of the field, if it is an array; −1: none. */
  int32_t index;
  /** Zero. */
  uint32_t reserved;
  /** The value found, in the field's unit; for stamps the distance from the expected value [s]. */
  double value;
  /** The bound that was broken, in the same unit; NaN: none. */
  double bound;
  /** When it was refused [ns]; 0: nothing was refused yet. */
  uint64_t at_ns;
} foretrace_refused;
FORETRACE_ASSERT(sizeof(foretrace_refused) == 40);
FORETRACE_ASSERT(offsetof(foretrace_refused, reason) == 0);
FORETRACE_ASSERT(offsetof(foretrace_refused, field) == 4);
FORETRACE_ASSERT(offsetof(foretrace_refused, index) == 8);
FORETRACE_ASSERT(offsetof(foretrace_refused, reserved) == 12);
FORETRACE_ASSERT(offsetof(foretrace_refused, value) == 16);
FORETRACE_ASSERT(offsetof(foretrace_refused, bound) == 24);
FORETRACE_ASSERT(offsetof(foretrace_refused, at_ns) == 32);

/** The straight way home from the measured joints, or the rest of it while the arm moves along it. */
typedef struct foretrace_way_home {
  /** Distance from home of the joint that turns farthest [rad]; negative: unknown. */
  double farthest_rad;
  /** Duration of the way, or of the rest of it, without obstacles [s]; negative: unknown. */
  double left_s;
  /** In mode Mode.Homing, the fraction of the way done; negative: in another mode. */
  double share;
  /** The joint that turns farthest, from 0, base first. */
  uint32_t joint;
  /** In mode Mode.Homing: 1 once the way was found clear, and the motion has begun. */
  uint32_t moving;
} foretrace_way_home;
FORETRACE_ASSERT(sizeof(foretrace_way_home) == 32);
FORETRACE_ASSERT(offsetof(foretrace_way_home, farthest_rad) == 0);
FORETRACE_ASSERT(offsetof(foretrace_way_home, left_s) == 8);
FORETRACE_ASSERT(offsetof(foretrace_way_home, share) == 16);
FORETRACE_ASSERT(offsetof(foretrace_way_home, joint) == 24);
FORETRACE_ASSERT(offsetof(foretrace_way_home, moving) == 28);

/** What happened, and what to do about it: UTF-8, padded with NUL. */
typedef struct foretrace_note_words {
  /** What happened; all NUL: none. */
  uint8_t text[192];
  /** What to do about it. */
  uint8_t to_do[192];
} foretrace_note_words;
FORETRACE_ASSERT(sizeof(foretrace_note_words) == 384);
FORETRACE_ASSERT(offsetof(foretrace_note_words, text) == 0);
FORETRACE_ASSERT(offsetof(foretrace_note_words, to_do) == 192);

/** The predictor of another process. Counts are since the daemon started, saturated. */
typedef struct foretrace_external_state {
  /** Its part in the preview in force, 0 to 1; the rest is the fallback's. Negative: it is not chosen. */
  float weight;
  /** Evidence that it is better than the fallback, -10 to 10: used from 5 on, until it falls below 0. */
  float evidence;
  /** Mean of weight over the steps that closed while it was chosen; negative: none did. */
  float share;
  /** Grid steps that closed while it was chosen. */
  uint32_t steps;
  /** Those of them that had a preview of their own before the next one closed. */
  uint32_t hits;
  /** Previews that were taken over. */
  uint32_t taken;
  /** Previews that a newer one of the same tick replaced, or that found no room. */
  uint32_t lost;
  /** Grid steps that could not be sent. */
  uint32_t unsent;
  /** Previews refused by reason, in the order of PreviewRefusal from Malformed on. */
  uint32_t refused[8];
  /** From a grid step sent to its preview received, over the last two seconds; 0: nothing came. */
  foretrace_percentiles latency;
} foretrace_external_state;
FORETRACE_ASSERT(sizeof(foretrace_external_state) == 80);
FORETRACE_ASSERT(offsetof(foretrace_external_state, weight) == 0);
FORETRACE_ASSERT(offsetof(foretrace_external_state, evidence) == 4);
FORETRACE_ASSERT(offsetof(foretrace_external_state, share) == 8);
FORETRACE_ASSERT(offsetof(foretrace_external_state, steps) == 12);
FORETRACE_ASSERT(offsetof(foretrace_external_state, hits) == 16);
FORETRACE_ASSERT(offsetof(foretrace_external_state, taken) == 20);
FORETRACE_ASSERT(offsetof(foretrace_external_state, lost) == 24);
FORETRACE_ASSERT(offsetof(foretrace_external_state, unsent) == 28);
FORETRACE_ASSERT(offsetof(foretrace_external_state, refused) == 32);
FORETRACE_ASSERT(offsetof(foretrace_external_state, latency) == 64);

/** State of the daemon. Distributions are over all ticks since start, after warm-up. */
typedef struct foretrace_status {
  /** Stamp: when it was sent. */
  foretrace_header header;
  /** Identifies this start of the daemon. */
  uint64_t daemon_id;
  /** Process number. */
  uint32_t pid;
  /** Mode. */
  uint32_t mode;
  /** FaultReason. */
  uint32_t fault;
  /** missing_rights. */
  uint32_t missing_rights;
  /** Ticks per second, configured [Hz]. */
  double rate_hz;
  /** Ticks per second over the last second, measured [Hz]. */
  double measured_rate_hz;
  /** Newest tick. */
  uint64_t tick;
  /** Since the daemon started [ns]. */
  uint64_t uptime_ns;
  /** Number of changes of live settings. */
  uint64_t settings_revision;
  /** Hash of the settings. */
  uint64_t settings_hash;
  /** Distribution of each Stage. */
  foretrace_percentiles stages[10];
  /** Totals. */
  foretrace_counters counters;
  /** Trust α. */
  double trust;
  /** Target of α. */
  double trust_target;
  /** TrustReason. */
  uint32_t trust_reason;
  /** The active predictor; none before the first tick. */
  foretrace_predictor_name predictor;
  /** Age of the newest pen sample [ns]; u64.MAX: none. */
  uint64_t pen_age_ns;
  /** Age of the newest joint state [ns]; u64.MAX: none. */
  uint64_t joint_state_age_ns;
  /** Parts of the latency, each the median over about the last second. */
  foretrace_chain chain;
  /** From the device stamp of a pen sample to the first command handed over after it was received. */
  foretrace_latency pen_to_command;
  /** From a command handed over to its motion: to its stamp, plus the arm's measured lag. */
  foretrace_latency command_to_motion;
  /** Version of the weights in use. */
  uint64_t learner_version;
  /** Grid steps learnt from. */
  uint64_t learner_updates;
  /** Sets of weights handed to the loop. */
  uint64_t learner_promotions;
  /** Sets of weights rolled back. */
  uint64_t learner_rollbacks;
  /** Sets of weights not handed over: non-finite or worse. */
  uint64_t learner_refused;
  /** Age of the weights in use [ns]. */
  uint64_t learner_age_ns;
  /** Root mean square of the one-step prediction error, recent [m]; negative: none. */
  double predictor_rms_m;
  /** Radius about the plan's first reference in which the pen is expected in nine of ten cases [m]; negative: unknown. */
  double predictor_band_m;
  /** The arm's lag, and the plan's dead time. */
  foretrace_arm_lag arm_lag;
  /** Score of the measured arm. */
  foretrace_tracking tracking;
  /** Score of the arm as it would be at Hold (trust 0), at the same instants. */
  foretrace_tracking ghost;
  /** How long the pen wrote while both were compared [s]. */
  double compared_s;
  /** GhostState. */
  uint32_t ghost_state;
  /** Median cost of the ghost per tick, on a thread that no tick waits for [ns]. */
  uint32_t ghost_cost_ns;
  /** Heap allocations per tick after warm-up, ticks with a connection change left out. */
  double allocations_per_tick;
  /** Evidence behind the newest latched stop. */
  foretrace_stop_detail stop;
  /** Extremes of the measured tool. */
  foretrace_tool_extent extent;
  /** Fraction of the commanded speed at which the arm moves; negative: unknown. */
  double arm_speed_share;
  /** The newest pen sample that was refused. */
  foretrace_refused pen_refused;
  /** The newest joint state that was refused. */
  foretrace_refused joints_refused;
  /** The newest dead-man message that was refused. */
  foretrace_refused enable_refused;
  /** The newest echo of a command that was rejected. */
  foretrace_refused echo_refused;
  /** The way home. */
  foretrace_way_home way_home;
  /** The line to the arm's controller. */
  foretrace_arm_line arm_line;
  /** Measured joints [rad]; zero while there is no joint state. */
  double joints_q[6];
  /** The measured tool in the base frame: position [m], then rotation vector [rad], as a pendant shows it. */
  double tool_base[6];
  /** The measured tool in the plane's frame [m]: along the paper, across it, above it. */
  double tool_plane_m[3];
  /** When the note of the arm's process came into force [ns]; 0: there is none. */
  uint64_t note_since_ns;
  /** That note. */
  foretrace_note_words note;
  /** The predictor of another process. */
  foretrace_external_state external;
} foretrace_status;
FORETRACE_ASSERT(sizeof(foretrace_status) == 2048);
FORETRACE_ASSERT(offsetof(foretrace_status, header) == 0);
FORETRACE_ASSERT(offsetof(foretrace_status, daemon_id) == 24);
FORETRACE_ASSERT(offsetof(foretrace_status, pid) == 32);
FORETRACE_ASSERT(offsetof(foretrace_status, mode) == 36);
FORETRACE_ASSERT(offsetof(foretrace_status, fault) == 40);
FORETRACE_ASSERT(offsetof(foretrace_status, missing_rights) == 44);
FORETRACE_ASSERT(offsetof(foretrace_status, rate_hz) == 48);
FORETRACE_ASSERT(offsetof(foretrace_status, measured_rate_hz) == 56);
FORETRACE_ASSERT(offsetof(foretrace_status, tick) == 64);
FORETRACE_ASSERT(offsetof(foretrace_status, uptime_ns) == 72);
FORETRACE_ASSERT(offsetof(foretrace_status, settings_revision) == 80);
FORETRACE_ASSERT(offsetof(foretrace_status, settings_hash) == 88);
FORETRACE_ASSERT(offsetof(foretrace_status, stages) == 96);
FORETRACE_ASSERT(offsetof(foretrace_status, counters) == 256);
FORETRACE_ASSERT(offsetof(foretrace_status, trust) == 648);
FORETRACE_ASSERT(offsetof(foretrace_status, trust_target) == 656);
FORETRACE_ASSERT(offsetof(foretrace_status, trust_reason) == 664);
FORETRACE_ASSERT(offsetof(foretrace_status, predictor) == 668);
FORETRACE_ASSERT(offsetof(foretrace_status, pen_age_ns) == 696);
FORETRACE_ASSERT(offsetof(foretrace_status, joint_state_age_ns) == 704);
FORETRACE_ASSERT(offsetof(foretrace_status, chain) == 712);
FORETRACE_ASSERT(offsetof(foretrace_status, pen_to_command) == 752);
FORETRACE_ASSERT(offsetof(foretrace_status, command_to_motion) == 856);
FORETRACE_ASSERT(offsetof(foretrace_status, learner_version) == 960);
FORETRACE_ASSERT(offsetof(foretrace_status, learner_updates) == 968);
FORETRACE_ASSERT(offsetof(foretrace_status, learner_promotions) == 976);
FORETRACE_ASSERT(offsetof(foretrace_status, learner_rollbacks) == 984);
FORETRACE_ASSERT(offsetof(foretrace_status, learner_refused) == 992);
FORETRACE_ASSERT(offsetof(foretrace_status, learner_age_ns) == 1000);
FORETRACE_ASSERT(offsetof(foretrace_status, predictor_rms_m) == 1008);
FORETRACE_ASSERT(offsetof(foretrace_status, predictor_band_m) == 1016);
FORETRACE_ASSERT(offsetof(foretrace_status, arm_lag) == 1024);
FORETRACE_ASSERT(offsetof(foretrace_status, tracking) == 1056);
FORETRACE_ASSERT(offsetof(foretrace_status, ghost) == 1096);
FORETRACE_ASSERT(offsetof(foretrace_status, compared_s) == 1136);
FORETRACE_ASSERT(offsetof(foretrace_status, ghost_state) == 1144);
FORETRACE_ASSERT(offsetof(foretrace_status, ghost_cost_ns) == 1148);
FORETRACE_ASSERT(offsetof(foretrace_status, allocations_per_tick) == 1152);
FORETRACE_ASSERT(offsetof(foretrace_status, stop) == 1160);
FORETRACE_ASSERT(offsetof(foretrace_status, extent) == 1192);
FORETRACE_ASSERT(offsetof(foretrace_status, arm_speed_share) == 1224);
FORETRACE_ASSERT(offsetof(foretrace_status, pen_refused) == 1232);
FORETRACE_ASSERT(offsetof(foretrace_status, joints_refused) == 1272);
FORETRACE_ASSERT(offsetof(foretrace_status, enable_refused) == 1312);
FORETRACE_ASSERT(offsetof(foretrace_status, echo_refused) == 1352);
FORETRACE_ASSERT(offsetof(foretrace_status, way_home) == 1392);
FORETRACE_ASSERT(offsetof(foretrace_status, arm_line) == 1424);
FORETRACE_ASSERT(offsetof(foretrace_status, joints_q) == 1456);
FORETRACE_ASSERT(offsetof(foretrace_status, tool_base) == 1504);
FORETRACE_ASSERT(offsetof(foretrace_status, tool_plane_m) == 1552);
FORETRACE_ASSERT(offsetof(foretrace_status, note_since_ns) == 1576);
FORETRACE_ASSERT(offsetof(foretrace_status, note) == 1584);
FORETRACE_ASSERT(offsetof(foretrace_status, external) == 1968);

/** One answer. */
typedef struct foretrace_control_response {
  /** The request's token. */
  uint64_t token;
  /** The daemon's host_boot_id(). */
  uint64_t boot_id;
  /** The daemon's daemon_id, as in its status. */
  uint64_t daemon_id;
  /** A number of the answer: trust α for most, the invalid value for refusals. */
  double value;
  /** ControlStatus. */
  int32_t status;
  /** A number of the answer: the crate.Mode for Ok, joint or line for refusals. */
  uint32_t detail;
  /** Bytes of message in use. */
  uint32_t message_len;
  /** Zero. */
  uint32_t reserved;
  /** Readable text, UTF-8. */
  uint8_t message[160];
} foretrace_control_response;
FORETRACE_ASSERT(sizeof(foretrace_control_response) == 208);
FORETRACE_ASSERT(offsetof(foretrace_control_response, token) == 0);
FORETRACE_ASSERT(offsetof(foretrace_control_response, boot_id) == 8);
FORETRACE_ASSERT(offsetof(foretrace_control_response, daemon_id) == 16);
FORETRACE_ASSERT(offsetof(foretrace_control_response, value) == 24);
FORETRACE_ASSERT(offsetof(foretrace_control_response, status) == 32);
FORETRACE_ASSERT(offsetof(foretrace_control_response, detail) == 36);
FORETRACE_ASSERT(offsetof(foretrace_control_response, message_len) == 40);
FORETRACE_ASSERT(offsetof(foretrace_control_response, reserved) == 44);
FORETRACE_ASSERT(offsetof(foretrace_control_response, message) == 48);

/** A closed step of the pen's grid. */
typedef struct foretrace_pen_step {
  /** Stamp: when the tick that closed it ended. */
  foretrace_header header;
  /** Its number on the grid, one more per step. */
  uint64_t index;
  /** The instant at its end [ns]. */
  uint64_t time_ns;
  /** Length of a step [ns]. */
  uint64_t step_ns;
  /** Position at its end [m]. */
  double x_m;
  /** Position at its end [m]. */
  double y_m;
  /** Displacement since the step before [m]; 0 unless the motion continues. */
  double dx_m;
  /** Displacement since the step before [m]; 0 unless the motion continues. */
  double dy_m;
  /** Running scale [m per unit]: of normalised displacements the root mean square is 10 per axis. */
  double scale_m;
  /** Longest displacement per step that is taken over [m]; longer ones are shortened to it, and four times as long ones refused. */
  double longest_m;
  /** PenMotion. */
  uint32_t motion;
  /** 1: the pen touches the paper. */
  uint32_t contact;
  /** Positions that a preview should have: as many as the plan looks at, and more for a late one. */
  uint32_t wanted;
  /** Zero. */
  uint32_t reserved;
} foretrace_pen_step;
FORETRACE_ASSERT(sizeof(foretrace_pen_step) == 112);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, header) == 0);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, index) == 24);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, time_ns) == 32);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, step_ns) == 40);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, x_m) == 48);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, y_m) == 56);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, dx_m) == 64);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, dy_m) == 72);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, scale_m) == 80);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, longest_m) == 88);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, motion) == 96);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, contact) == 100);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, wanted) == 104);
FORETRACE_ASSERT(offsetof(foretrace_pen_step, reserved) == 108);

/** Where the pen will be after a grid step. */
typedef struct foretrace_pen_preview {
  /** Stamp: when it was sent. */
  foretrace_header header;
  /** Number of the step after which it predicts (PenStep.index). */
  uint64_t base_index;
  /** Positions that count, at most PREVIEW_STEPS; see PenStep.wanted. */
  uint32_t count;
  /** preview_flags. */
  uint32_t flags;
  /** Position i + 1 steps after the base [m]. */
  double x_m[64];
  /** Position i + 1 steps after the base [m]. */
  double y_m[64];
  /** Radius about it in which the pen is expected in nine of ten cases [m]; see flags. */
  double radius_m[64];
} foretrace_pen_preview;
FORETRACE_ASSERT(sizeof(foretrace_pen_preview) == 1576);
FORETRACE_ASSERT(offsetof(foretrace_pen_preview, header) == 0);
FORETRACE_ASSERT(offsetof(foretrace_pen_preview, base_index) == 24);
FORETRACE_ASSERT(offsetof(foretrace_pen_preview, count) == 32);
FORETRACE_ASSERT(offsetof(foretrace_pen_preview, flags) == 36);
FORETRACE_ASSERT(offsetof(foretrace_pen_preview, x_m) == 40);
FORETRACE_ASSERT(offsetof(foretrace_pen_preview, y_m) == 552);
FORETRACE_ASSERT(offsetof(foretrace_pen_preview, radius_m) == 1064);

/** The layout of everything above, in one number. */
#define FORETRACE_LAYOUT_HASH UINT64_C(0x6f32550d2a5bc394)

#ifdef __cplusplus
}
#endif

#endif
