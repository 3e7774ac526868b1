// Effort controller of ros2_control: tau = tracking_torque(q, v, a_ref + kp (q_ref - q) + kd (v_ref - v), v_ref, width),
// of the dynamics that `signid export MODEL --c arm.c --ros arm.yaml` writes.
#pragma once

#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "rclcpp/subscription.hpp"
#include "realtime_tools/realtime_thread_safe_box.hpp"
#include "trajectory.hpp"
#include "trajectory_msgs/msg/joint_trajectory.hpp"

namespace signid_controller
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
  struct Received
  {
    Trajectory trajectory;
    bool unread = false;
  };

  void receive(const trajectory_msgs::msg::JointTrajectory & message);
  bool read_state();

  // parameters
  std::vector<std::string> joints_;  // dynamics.joints, in the order of arm.h
  std::vector<double> effort_limit_;  // [N.m or N] dynamics.joint.NAME.effort_limit; infinite: none
  std::vector<double> kp_;  // [1/s2] acceleration per error of position
  std::vector<double> kd_;  // [1/s] acceleration per error of velocity
  double friction_width_ = 0.0;  // [rad/s or m/s] over which dry friction changes its sign with the reference

  rclcpp::Subscription<trajectory_msgs::msg::JointTrajectory>::SharedPtr subscription_;
  realtime_tools::RealtimeThreadSafeBox<Received> received_;  // from the subscription to update

  // state of the loop, allocated in on_configure
  Trajectory trajectory_;
  Reference reference_;
  double elapsed_ = 0.0;  // [s] since the start of the trajectory
  int missed_ = 0;  // cycles in a row in which an interface could not be read or written
  std::vector<double> position_, velocity_, acceleration_, effort_;
};

}  // namespace signid_controller
