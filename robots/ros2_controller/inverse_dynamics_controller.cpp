#include "inverse_dynamics_controller.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <stdexcept>
#include <utility>

#include "arm.h"
#include "hardware_interface/types/hardware_interface_type_values.hpp"
#include "lifecycle_msgs/msg/state.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/logging.hpp"
#include "rclcpp/qos.hpp"

namespace signid_controller
{

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;
using trajectory_msgs::msg::JointTrajectory;

namespace
{

constexpr int kMissedCycles = 10;  // in a row, with the last state or command in force

bool valid_gains(const std::vector<double> & gains)
{
  return gains.size() == SIGNID_JOINTS &&
         std::all_of(gains.begin(), gains.end(), [](double x) {return std::isfinite(x) && x >= 0.0;});
}

}  // namespace

CallbackReturn InverseDynamicsController::on_init()
{
  try {
    auto_declare<std::vector<std::string>>("dynamics.joints", {});
    auto_declare<std::vector<double>>("kp", {});
    auto_declare<std::vector<double>>("kd", {});
    auto_declare<double>("friction_width", 0.01);
  } catch (const std::exception & error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::ERROR;
  }
  return CallbackReturn::SUCCESS;
}

CallbackReturn InverseDynamicsController::on_configure(const rclcpp_lifecycle::State &)
{
  joints_ = get_node()->get_parameter("dynamics.joints").as_string_array();
  kp_ = get_node()->get_parameter("kp").as_double_array();
  kd_ = get_node()->get_parameter("kd").as_double_array();
  friction_width_ = get_node()->get_parameter("friction_width").as_double();
  try {
    if (joints_.size() != SIGNID_JOINTS) {
      throw std::invalid_argument("dynamics.joints does not have the joints of arm.h: load the arm.yaml written with it");
    }
    if (!valid_gains(kp_) || !valid_gains(kd_)) {
      throw std::invalid_argument("kp and kd need one number for each joint, 0 or more");
    }
    if (!(std::isfinite(friction_width_) && friction_width_ > 0.0)) {
      throw std::invalid_argument("friction_width is not above 0");
    }
    effort_limit_.clear();
    for (const auto & joint : joints_) {
      const auto name = "dynamics.joint." + joint + ".effort_limit";
      effort_limit_.push_back(auto_declare<double>(name, std::numeric_limits<double>::infinity()));
      if (!(effort_limit_.back() > 0.0)) {
        throw std::invalid_argument(name + " is not above 0");
      }
    }
  } catch (const std::exception & error) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
    return CallbackReturn::FAILURE;
  }
  const std::vector<double> zeros(SIGNID_JOINTS, 0.0);
  position_ = velocity_ = acceleration_ = effort_ = zeros;
  reference_ = {zeros, zeros, zeros};
  subscription_ = get_node()->create_subscription<JointTrajectory>(
    "~/joint_trajectory", rclcpp::SystemDefaultsQoS(), [this](const JointTrajectory & message) {receive(message);});
  return CallbackReturn::SUCCESS;
}

CallbackReturn InverseDynamicsController::on_activate(const rclcpp_lifecycle::State &)
{
  const auto finite = [](double x) {return std::isfinite(x);};
  if (!read_state() || !std::all_of(position_.begin(), position_.end(), finite)) {
    RCLCPP_ERROR(get_node()->get_logger(), "positions or velocities cannot be read");
    return CallbackReturn::FAILURE;
  }
  received_.set([](Received & received) {received.unread = false;});
  trajectory_.stop();
  reference_.position = position_;
  std::fill(reference_.velocity.begin(), reference_.velocity.end(), 0.0);
  std::fill(reference_.acceleration.begin(), reference_.acceleration.end(), 0.0);
  missed_ = 0;
  return CallbackReturn::SUCCESS;
}

CallbackReturn InverseDynamicsController::on_deactivate(const rclcpp_lifecycle::State &)
{
  bool complete = true;
  for (auto & command : command_interfaces_) {
    complete = command.set_value(0.0) && complete;
  }
  return complete ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
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

void InverseDynamicsController::receive(const JointTrajectory & message)
{
  try {
    if (get_lifecycle_state().id() != lifecycle_msgs::msg::State::PRIMARY_STATE_ACTIVE) {
      throw std::invalid_argument("the controller is not active");
    }
    Received next{Trajectory(message, joints_), true};
    received_.set([&next](Received & received) {std::swap(received, next);});
  } catch (const std::invalid_argument & error) {
    RCLCPP_WARN(get_node()->get_logger(), "trajectory refused: %s", error.what());
  }
}

bool InverseDynamicsController::read_state()
{
  bool complete = true;
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    const auto position = state_interfaces_[2 * j].get_optional();
    const auto velocity = state_interfaces_[2 * j + 1].get_optional();
    complete = complete && position && velocity;
    position_[j] = position.value_or(position_[j]);
    velocity_[j] = velocity.value_or(velocity_[j]);
  }
  return complete;
}

// No allocation, no waiting, no logging: a new trajectory is swapped in, and the old one is freed by `receive`.
return_type InverseDynamicsController::update(const rclcpp::Time &, const rclcpp::Duration & period)
{
  received_.try_set([this](Received & received) {
    if (received.unread) {
      std::swap(trajectory_, received.trajectory);
      received.unread = false;
      trajectory_.start(reference_);
      elapsed_ = 0.0;
    }
  });
  elapsed_ += period.seconds();
  trajectory_.evaluate(elapsed_, reference_);
  bool complete = read_state();
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    acceleration_[j] = reference_.acceleration[j] + kp_[j] * (reference_.position[j] - position_[j]) +
                       kd_[j] * (reference_.velocity[j] - velocity_[j]);
  }
  signid_tracking_torque(
    position_.data(), velocity_.data(), acceleration_.data(), reference_.velocity.data(), friction_width_,
    effort_.data());
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    if (!std::isfinite(acceleration_[j]) || !std::isfinite(effort_[j])) {
      return return_type::ERROR;  // the controller manager then deactivates the controller
    }
  }
  for (std::size_t j = 0; j < joints_.size(); ++j) {
    const double effort = std::clamp(effort_[j], -effort_limit_[j], effort_limit_[j]);
    complete = command_interfaces_[j].set_value(effort) && complete;
  }
  missed_ = complete ? 0 : missed_ + 1;
  return missed_ > kMissedCycles ? return_type::ERROR : return_type::OK;
}

}  // namespace signid_controller

PLUGINLIB_EXPORT_CLASS(signid_controller::InverseDynamicsController, controller_interface::ControllerInterface)
