// Effort controller for ros2_controllers: tau = inverse_dynamics(q, v, a_desired + kp (q_desired - q) + kd (v_desired - v)).
// The dynamics are those of a signid model: signid export result/model.json --c arm.c --ros arm.yaml
#pragma once

#include <string>
#include <vector>

#include "arm.h"
#include "controller_interface/controller_interface.hpp"

namespace signid_example
{

class InverseDynamicsController : public controller_interface::ControllerInterface
{
public:
  controller_interface::CallbackReturn on_init() override;
  controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State & previous) override;
  controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State & previous) override;
  controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State & previous) override;
  controller_interface::InterfaceConfiguration command_interface_configuration() const override;
  controller_interface::InterfaceConfiguration state_interface_configuration() const override;
  controller_interface::return_type update(const rclcpp::Time & time, const rclcpp::Duration & period) override;

private:
  static constexpr int kJoints = SIGNID_JOINTS;
  std::vector<std::string> joints_;  // parameter "joints", in the order that arm.h lists
  double kp_ = 0.0;  // [1/s2] parameter "kp": stiffness per inertia; 0: gravity and friction compensation alone
  double kd_ = 0.0;  // [1/s] parameter "kd": damping per inertia
  double goal_[kJoints] = {};  // [rad or m] positions at activation; a real controller takes a trajectory
};

}  // namespace signid_example
