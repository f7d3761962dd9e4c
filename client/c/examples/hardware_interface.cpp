// A hardware interface at 500 Hz, for an arm that is where it is told to be at once. Ends when its standard
// input does.
#include <algorithm>
#include <foretrace/foretrace.hpp>
#include <iostream>
#include <poll.h>
#include <thread>
#include <unistd.h>

static bool wanted() {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  char byte = 0;
  return poll(&input, 1, 0) == 0 || read(STDIN_FILENO, &byte, 1) > 0;
}

int main() try {
  foretrace::Attachment attachment;
  foretrace::Commands commands = attachment.commands();
  foretrace::JointStates states = attachment.joint_states();
  std::array<double, 6> q{3.1416, -1.3, 1.8, -2.0708, -1.5708, 0.0};  // home of the preset ur5
  while (wanted()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    const std::uint64_t now_ns = foretrace::now_ns();
    const foretrace::Demand demand = commands.demand_at(now_ns);
    if (demand.follow) q = demand.q;
    foretrace_joint_state state = commands.echo();
    std::copy(q.begin(), q.end(), state.q);
    std::copy(demand.qd.begin(), demand.qd.end(), state.qd);  // a real arm brakes where it does not follow
    state.safety_mode = FORETRACE_SAFETY_MODE_NORMAL;
    state.robot_mode = FORETRACE_ROBOT_MODE_RUNNING;
    states.publish(now_ns, state);
  }
  return 0;
} catch (const foretrace::Error &error) {
  std::cerr << error.what() << '\n';
  return 1;
}
