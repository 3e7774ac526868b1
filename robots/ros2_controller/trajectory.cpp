#include "trajectory.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace signid_controller
{

namespace
{

using Message = trajectory_msgs::msg::JointTrajectory;

void require(bool valid, const std::string & reason)
{
  if (!valid) {
    throw std::invalid_argument(reason);
  }
}

// Index in the message of each joint.
std::vector<std::size_t> order_of(const std::vector<std::string> & named, const std::vector<std::string> & joints)
{
  for (const auto & name : named) {
    require(std::count(joints.begin(), joints.end(), name) == 1, "joint " + name + " is unknown");
    require(std::count(named.begin(), named.end(), name) == 1, "joint " + name + " is named twice");
  }
  std::vector<std::size_t> order;
  for (const auto & joint : joints) {
    const auto found = std::find(named.begin(), named.end(), joint);
    require(found != named.end(), "joint " + joint + " is missing");
    order.push_back(static_cast<std::size_t>(found - named.begin()));
  }
  return order;
}

// Numbers of a point in the order of the joints; zeros if the message has none.
std::vector<double> ordered(
  const std::vector<double> & given, const std::vector<std::size_t> & order, bool present, const std::string & what)
{
  require(given.size() == (present ? order.size() : 0), "wrong number of " + what);
  std::vector<double> numbers(order.size(), 0.0);
  for (std::size_t j = 0; present && j < order.size(); ++j) {
    numbers[j] = given[order[j]];
    require(std::isfinite(numbers[j]), what + " are not finite");
  }
  return numbers;
}

}  // namespace

Trajectory::Trajectory(const Message & message, const std::vector<std::string> & joints)
{
  const auto order = order_of(message.joint_names, joints);
  require(!message.points.empty(), "it has no points");
  has_velocities_ = !message.points[0].velocities.empty();
  has_accelerations_ = !message.points[0].accelerations.empty();
  require(has_velocities_ || !has_accelerations_, "accelerations need velocities");
  const std::vector<double> none(joints.size(), 0.0);
  times_.push_back(0.0);
  points_.push_back({none, none, none});
  double last = -1.0;
  for (const auto & point : message.points) {
    const double time = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec;
    require(time >= 0.0 && time > last, "times do not increase from 0");
    last = time;
    Reference next{
      ordered(point.positions, order, true, "positions"),
      ordered(point.velocities, order, has_velocities_, "velocities"),
      ordered(point.accelerations, order, has_accelerations_, "accelerations")};
    if (time > 0.0) {  // at 0, the reference at the start stands for it
      times_.push_back(time);
      points_.push_back(next);
    }
  }
  require(times_.size() > 1, "its only point is at time 0");
  require(points_.back().velocity == none, "it does not end at rest");
  for (std::size_t k = 2; k < points_.size(); ++k) {
    estimate_velocities(k);
  }
}

void Trajectory::start(const Reference & present)
{
  points_[0] = present;
  estimate_velocities(1);
}

void Trajectory::estimate_velocities(std::size_t k)
{
  if (has_velocities_ || k + 1 == points_.size()) {
    return;
  }
  for (std::size_t j = 0; j < points_[k].position.size(); ++j) {
    const double before = points_[k].position[j] - points_[k - 1].position[j];
    const double after = points_[k + 1].position[j] - points_[k].position[j];
    const bool reverses = before * after <= 0.0;
    points_[k].velocity[j] = reverses ? 0.0 : (before + after) / (times_[k + 1] - times_[k - 1]);
  }
}

void Trajectory::evaluate(double time, Reference & reference) const
{
  if (times_.empty()) {
    return;
  }
  const auto next = std::upper_bound(times_.begin(), times_.end(), time);
  if (next == times_.end()) {
    for (std::size_t j = 0; j < reference.position.size(); ++j) {
      reference.position[j] = points_.back().position[j];
      reference.velocity[j] = reference.acceleration[j] = 0.0;
    }
    return;
  }
  const auto k = static_cast<std::size_t>(next - times_.begin());
  const Reference & from = points_[k - 1];
  const Reference & to = points_[k];
  const double span = times_[k] - times_[k - 1];
  const double s = (time - times_[k - 1]) / span;
  for (std::size_t j = 0; j < reference.position.size(); ++j) {
    // polynomial p0 + v0 s + c2 s2 + ... + c5 s5 over the share s of the segment: velocities times its span
    const double v0 = from.velocity[j] * span, v1 = to.velocity[j] * span, d = to.position[j] - from.position[j];
    double c2 = 3 * d - 2 * v0 - v1, c3 = v0 + v1 - 2 * d, c4 = 0.0, c5 = 0.0;
    if (has_accelerations_) {
      const double a0 = from.acceleration[j] * span * span, a1 = to.acceleration[j] * span * span;
      c2 = a0 / 2;
      c3 = 10 * d - 6 * v0 - 4 * v1 - (3 * a0 - a1) / 2;
      c4 = -15 * d + 8 * v0 + 7 * v1 + (3 * a0 - 2 * a1) / 2;
      c5 = 6 * d - 3 * (v0 + v1) - (a0 - a1) / 2;
    }
    reference.position[j] = from.position[j] + s * (v0 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
    reference.velocity[j] = (v0 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / span;
    reference.acceleration[j] = (2 * c2 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (span * span);
  }
}

}  // namespace signid_controller
