// Runs the controller on one state, given on the command line as q and v, and prints interfaces and torque.
#include <cstdio>
#include <cstdlib>
#include "inverse_dynamics_controller.hpp"
int main(int, char ** argv)
{
  constexpr int n = SIGNID_JOINTS;
  signid_example::InverseDynamicsController controller;
  controller.on_init();
  auto & given = controller.node->parameters;
  for (int j = 0; j < n; ++j) {given["joints"].names.push_back("joint_" + std::to_string(j + 1));}
  given["kd"].number = 2.0;
  if (controller.on_configure({}) != controller_interface::CallbackReturn::SUCCESS) {return 1;}
  for (const auto & name : controller.command_interface_configuration().names) {std::printf("%s ", name.c_str());}
  for (const auto & name : controller.state_interface_configuration().names) {std::printf("%s ", name.c_str());}
  controller.state_interfaces_.resize(2 * n);
  controller.command_interfaces_.resize(n);
  for (int k = 0; k < 2 * n; ++k) {controller.state_interfaces_[k].value = std::atof(argv[1 + k]);}
  controller.on_activate({});
  if (controller.update({}, {}) != controller_interface::return_type::OK) {return 2;}
  std::printf("\n");
  for (const auto & command : controller.command_interfaces_) {std::printf("%.17g ", command.value);}
  controller.on_deactivate({});
  return controller.command_interfaces_[0].value == 0.0 ? 0 : 3;
}
