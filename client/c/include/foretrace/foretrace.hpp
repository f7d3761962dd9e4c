// libforetrace for C++17: handles that close themselves, and exceptions with the library's text. Everything in
// here is used in the thread that made it.
#ifndef FORETRACE_HPP
#define FORETRACE_HPP

#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "foretrace.h"

namespace foretrace {

using Nanoseconds = std::chrono::nanoseconds;

/// What the library could not do: its code (foretrace_error), and what to do about it.
class Error : public std::runtime_error {
 public:
  Error(int code, const std::string &text) : std::runtime_error(text), code_(code) {}
  int code() const noexcept { return code_; }

 private:
  int code_;
};

/// The daemon or the gateway refused, with its reason and remedy.
class Refused : public Error {
 public:
  using Error::Error;
};

/// Throws where `code` is not 0.
inline void check(int code) {
  if (code == FORETRACE_REFUSED) throw Refused(code, foretrace_last_error());
  if (code != FORETRACE_OK) throw Error(code, foretrace_last_error());
}

inline std::uint64_t now_ns() noexcept { return foretrace_now_ns(); }

namespace detail {

inline std::uint64_t count(Nanoseconds time) { return time.count() > 0 ? static_cast<std::uint64_t>(time.count()) : 0; }
inline const char *text(const std::string &name) { return name.empty() ? nullptr : name.c_str(); }

/// Owns a handle; moves, does not copy.
class Handle {
 public:
  Handle() = default;
  explicit Handle(foretrace_handle handle) noexcept : handle_(handle) {}
  Handle(Handle &&other) noexcept : handle_(std::exchange(other.handle_, 0)) {}
  Handle &operator=(Handle &&other) noexcept {
    if (this != &other) {
      close();
      handle_ = std::exchange(other.handle_, 0);
    }
    return *this;
  }
  Handle(const Handle &) = delete;
  Handle &operator=(const Handle &) = delete;
  ~Handle() { close(); }
  foretrace_handle get() const noexcept { return handle_; }
  foretrace_handle release() noexcept { return std::exchange(handle_, 0); }

 private:
  void close() noexcept {
    if (handle_ != 0) foretrace_close(handle_);
    handle_ = 0;
  }
  foretrace_handle handle_ = 0;
};

/// What an attachment opens: it owns its handle, and nobody else makes one.
class Opened {
 protected:
  explicit Opened(Handle handle) noexcept : handle_(std::move(handle)) {}
  Handle handle_;
};

}  // namespace detail

/// The pen: send each measurement at once, repeat it while the pen rests.
class Pen : detail::Opened {
 public:
  /// Whether a daemon was connected.
  bool send(const foretrace_pen_sample &sample) {
    bool heard = false;
    check(foretrace_pen_send(handle_.get(), &sample, sizeof sample, &heard));
    return heard;
  }
  /// Who asked for the pen and has it now, if anybody.
  std::optional<std::string> handed_to() {
    std::array<char, 256> buffer{};
    check(foretrace_pen_handed_to(handle_.get(), buffer.data(), buffer.size()));
    return buffer[0] == '\0' ? std::nullopt : std::optional<std::string>(buffer.data());
  }

 private:
  friend class Attachment;
  using Opened::Opened;
};

/// The pen of a program of another user, through the socket of `foretrace gateway`.
class Gateway {
 public:
  explicit Gateway(const std::string &path) {
    foretrace_handle handle = 0;
    check(foretrace_gateway(path.c_str(), &handle));
    handle_ = detail::Handle(handle);
  }
  void send(const foretrace_pen_sample &sample) {
    check(foretrace_gateway_send(handle_.get(), &sample, sizeof sample));
  }
  /// Ends the connection; how many samples were passed on and refused.
  std::string finish() {
    std::array<char, 4096> buffer{};
    check(foretrace_gateway_finish(handle_.release(), buffer.data(), buffer.size()));
    return buffer.data();
  }

 private:
  detail::Handle handle_;
};

/// What an arm has to do at an instant.
struct Demand {
  /// Otherwise: brake to a stand and stay.
  bool follow = false;
  std::array<double, 6> q{};   ///< [rad]
  std::array<double, 6> qd{};  ///< [rad/s]
};

/// The joint commands.
class Commands : detail::Opened {
 public:
  /// The newest command; all zero, which means brake, where there is none yet.
  foretrace_joint_command latest() {
    foretrace_joint_command command{};
    check(foretrace_commands_latest(handle_.get(), &command, sizeof command, nullptr));
    return command;
  }
  /// What the newest command demands at `at_ns`. A command that cannot be used demands to brake.
  Demand demand_at(std::uint64_t at_ns) {
    Demand demand;
    const foretrace_joint_command command = latest();
    if (foretrace_demand_at(&command, sizeof command, at_ns, demand.q.data(), demand.qd.data(), &demand.follow) != 0)
      demand.follow = false;
    return demand;
  }
  /// A joint state that echoes the newest command taken.
  foretrace_joint_state echo() {
    foretrace_joint_state state{};
    check(foretrace_commands_echo(handle_.get(), &state, sizeof state));
    return state;
  }

 private:
  friend class Attachment;
  using Opened::Opened;
};

/// The place of the arm.
class JointStates : detail::Opened {
 public:
  /// Reports the arm as it was at `measured_ns`. Whether a daemon was connected.
  bool publish(std::uint64_t measured_ns, const foretrace_joint_state &state) {
    bool heard = false;
    check(foretrace_joint_states_publish(handle_.get(), measured_ns, &state, sizeof state, &heard));
    return heard;
  }
  /// Why the arm does not follow, and what an operator can do.
  void note(const std::string &why, const std::string &to_do) {
    check(foretrace_joint_states_note(handle_.get(), why.c_str(), to_do.c_str()));
  }
  void no_note() { check(foretrace_joint_states_note(handle_.get(), nullptr, nullptr)); }

 private:
  friend class Attachment;
  using Opened::Opened;
};

/// The records of all ticks.
class Telemetry : detail::Opened {
 public:
  /// Unread records, oldest first, at most `most`.
  std::vector<foretrace_tick_record> read(std::size_t most = 512) {
    std::vector<foretrace_tick_record> records(most);
    std::size_t count = 0;
    check(foretrace_telemetry_read(handle_.get(), records.data(), sizeof(foretrace_tick_record), most, &count));
    records.resize(count);
    return records;
  }
  std::uint64_t lost() {
    std::uint64_t lost = 0;
    check(foretrace_telemetry_lost(handle_.get(), &lost));
    return lost;
  }

 private:
  friend class Attachment;
  using Opened::Opened;
};

/// The daemon's status.
class StatusReader : detail::Opened {
 public:
  /// The next one; throws where none comes in time.
  foretrace_status next(Nanoseconds timeout) {
    foretrace_status status{};
    check(foretrace_status_next(handle_.get(), detail::count(timeout), &status, sizeof status));
    return status;
  }

 private:
  friend class Attachment;
  using Opened::Opened;
};

/// The steps of the pen's grid, while predictor `external` is chosen.
class PenSteps : detail::Opened {
 public:
  /// The next one; throws where none comes in time.
  foretrace_pen_step next(Nanoseconds timeout) {
    foretrace_pen_step step{};
    check(foretrace_pen_steps_next(handle_.get(), detail::count(timeout), &step, sizeof step));
    return step;
  }

 private:
  friend class Attachment;
  using Opened::Opened;
};

/// The predictor's place. Whether a daemon was connected.
class Previews : detail::Opened {
 public:
  bool send(const foretrace_pen_preview &preview) {
    bool heard = false;
    check(foretrace_previews_send(handle_.get(), &preview, sizeof preview, &heard));
    return heard;
  }

 private:
  friend class Attachment;
  using Opened::Opened;
};

/// The dead-man switch: beat every 20 ms while a hand holds it; its end stops the arm.
class DeadMan : detail::Opened {
 public:
  void beat() { check(foretrace_dead_man_beat(handle_.get())); }
  void stop() { check(foretrace_dead_man_stop(handle_.get())); }

 private:
  friend class Attachment;
  using Opened::Opened;
};

/// Stops the arm and keeps it stopped: needs no attachment. The mode after it.
inline std::string stop(std::uint32_t instance = 0, Nanoseconds timeout = std::chrono::seconds(1)) {
  std::array<char, 256> buffer{};
  check(foretrace_stop(instance, detail::count(timeout), buffer.data(), buffer.size()));
  return buffer.data();
}

/// An attachment to a running daemon. Makes the others, which outlive it.
class Attachment {
 public:
  explicit Attachment(std::uint32_t instance = 0, Nanoseconds wait = Nanoseconds::zero()) {
    foretrace_handle handle = 0;
    check(foretrace_attach(instance, detail::count(wait), &handle));
    handle_ = detail::Handle(handle);
  }
  bool daemon_is_up() {
    bool up = false;
    check(foretrace_daemon_is_up(handle_.get(), &up));
    return up;
  }
  /// Looks for a new daemon: FORETRACE_RENEWED means that everything else is to be made again.
  foretrace_change renew() {
    std::uint32_t change = 0;
    check(foretrace_renew(handle_.get(), &change));
    return static_cast<foretrace_change>(change);
  }
  /// The pen, which `take_over` long is asked for where another program has it.
  Pen pen(const std::string &name = "", Nanoseconds take_over = Nanoseconds::zero()) {
    return Pen(open([&](foretrace_handle *out) {
      return foretrace_pen(handle_.get(), detail::text(name), detail::count(take_over), out);
    }));
  }
  Commands commands(std::uint32_t buffer = 1) {
    return Commands(open([&](foretrace_handle *out) { return foretrace_commands(handle_.get(), buffer, out); }));
  }
  JointStates joint_states() {
    return JointStates(open([&](foretrace_handle *out) { return foretrace_joint_states(handle_.get(), out); }));
  }
  Telemetry telemetry() {
    return Telemetry(open([&](foretrace_handle *out) { return foretrace_telemetry(handle_.get(), out); }));
  }
  StatusReader status() {
    return StatusReader(open([&](foretrace_handle *out) { return foretrace_status_reader(handle_.get(), out); }));
  }
  PenSteps pen_steps() {
    return PenSteps(open([&](foretrace_handle *out) { return foretrace_pen_steps(handle_.get(), out); }));
  }
  Previews previews() {
    return Previews(open([&](foretrace_handle *out) { return foretrace_previews(handle_.get(), out); }));
  }
  DeadMan dead_man(const std::string &name = "", Nanoseconds take_over = Nanoseconds::zero()) {
    return DeadMan(open([&](foretrace_handle *out) {
      return foretrace_dead_man(handle_.get(), detail::text(name), detail::count(take_over), out);
    }));
  }
  void arm(Nanoseconds timeout = std::chrono::seconds(2)) { ask(FORETRACE_CONTROL_OP_ARM, timeout); }
  void disarm(Nanoseconds timeout = std::chrono::seconds(2)) { ask(FORETRACE_CONTROL_OP_DISARM, timeout); }
  void move_home(Nanoseconds timeout = std::chrono::seconds(2)) { ask(FORETRACE_CONTROL_OP_MOVE_HOME, timeout); }
  void reload(Nanoseconds timeout = std::chrono::seconds(8)) { ask(FORETRACE_CONTROL_OP_RELOAD, timeout); }
  void trust_auto(Nanoseconds timeout = std::chrono::seconds(2)) { ask(FORETRACE_CONTROL_OP_TRUST_AUTO, timeout); }
  /// By hand: 1 prediction only, 0 feedback only.
  void set_trust(double trust, Nanoseconds timeout = std::chrono::seconds(2)) {
    ask(FORETRACE_CONTROL_OP_SET_TRUST, timeout, trust);
  }
  void switch_predictor(const std::string &name, Nanoseconds timeout = std::chrono::seconds(2)) {
    ask(FORETRACE_CONTROL_OP_SWITCH_PREDICTOR, timeout, 0.0, name.c_str());
  }

 private:
  template <typename Open>
  static detail::Handle open(Open open) {
    foretrace_handle handle = 0;
    check(open(&handle));
    return detail::Handle(handle);
  }
  void ask(std::uint32_t operation, Nanoseconds timeout, double value = 0.0, const char *predictor = nullptr) {
    check(foretrace_request(handle_.get(), operation, value, predictor, detail::count(timeout), nullptr, 0));
  }
  detail::Handle handle_;
};

}  // namespace foretrace

#endif
