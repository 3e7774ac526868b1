#include "inverse_dynamics_controller.hpp"

#include <cmath>

#include "hardware_interface/types/hardware_interface_type_values.hpp"
#include "pluginlib/class_list_macros.hpp"

namespace signid_example
{

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;

CallbackReturn InverseDynamicsController::on_init()
{
  auto_declare<std::vector<std::string>>("joints", {});
  auto_declare<double>("kp", 0.0);
  auto_declare<double>("kd", 0.0);
  return CallbackReturn::SUCCESS;
}

CallbackReturn InverseDynamicsController::on_configure(const rclcpp_lifecycle::State &)
{
  joints_ = get_node()->get_parameter("joints").as_string_array();
  kp_ = get_node()->get_parameter("kp").as_double();
  kd_ = get_node()->get_parameter("kd").as_double();
  const bool valid = joints_.size() == kJoints && kp_ >= 0.0 && kd_ >= 0.0;
  return valid ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
}

CallbackReturn InverseDynamicsController::on_activate(const rclcpp_lifecycle::State &)
{
  for (int j = 0; j < kJoints; ++j) {
    goal_[j] = state_interfaces_[2 * j].get_value();
    if (!std::isfinite(goal_[j])) {
      return CallbackReturn::ERROR;
    }
  }
  return CallbackReturn::SUCCESS;
}

CallbackReturn InverseDynamicsController::on_deactivate(const rclcpp_lifecycle::State &)
{
  for (auto & command : command_interfaces_) {
    command.set_value(0.0);
  }
  return CallbackReturn::SUCCESS;
}

InterfaceConfiguration InverseDynamicsController::command_interface_configuration() const
{
  InterfaceConfiguration wanted{interface_configuration_type::INDIVIDUAL, {}};
  for (const auto & joint : joints_) {
    wanted.names.push_back(joint + "/" + hardware_interface::HW_IF_EFFORT);
  }
  return wanted;
}

InterfaceConfiguration InverseDynamicsController::state_interface_configuration() const
{
  InterfaceConfiguration wanted{interface_configuration_type::INDIVIDUAL, {}};
  for (const auto & joint : joints_) {
    wanted.names.push_back(joint + "/" + hardware_interface::HW_IF_POSITION);
    wanted.names.push_back(joint + "/" + hardware_interface::HW_IF_VELOCITY);
  }
  return wanted;
}

return_type InverseDynamicsController::update(const rclcpp::Time &, const rclcpp::Duration &)
{
  double q[kJoints], v[kJoints], a[kJoints], tau[kJoints];
  for (int j = 0; j < kJoints; ++j) {
    q[j] = state_interfaces_[2 * j].get_value();
    v[j] = state_interfaces_[2 * j + 1].get_value();
    a[j] = kp_ * (goal_[j] - q[j]) - kd_ * v[j];
  }
  signid_inverse_dynamics(q, v, a, tau);
  for (int j = 0; j < kJoints; ++j) {
    if (!std::isfinite(tau[j])) {
      return return_type::ERROR;
    }
  }
  for (int j = 0; j < kJoints; ++j) {
    command_interfaces_[j].set_value(tau[j]);
  }
  return return_type::OK;
}

}  // namespace signid_example

PLUGINLIB_EXPORT_CLASS(signid_example::InverseDynamicsController, controller_interface::ControllerInterface)
