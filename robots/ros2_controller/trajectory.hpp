// A joint trajectory as a continuous reference of positions, velocities and accelerations.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "trajectory_msgs/msg/joint_trajectory.hpp"

namespace signid_controller
{

struct Reference  // one number for each joint
{
  std::vector<double> position;  // [rad or m]
  std::vector<double> velocity;  // [rad/s or m/s]
  std::vector<double> acceleration;  // [rad/s2 or m/s2]
};

class Trajectory
{
public:
  Trajectory() = default;  // stopped

  // The points of a message, its joints put in order. Without velocities, those of the neighbouring points are used.
  // Throws std::invalid_argument: names, times or sizes that are not those of a trajectory of these joints.
  Trajectory(const trajectory_msgs::msg::JointTrajectory & message, const std::vector<std::string> & joints);

  // Holds the reference where it is. Does not free.
  void stop() {times_.clear();}

  // Puts the present reference before the first point. Does not allocate.
  void start(const Reference & present);

  // The reference at a time [s] after the start; the last point is held. Does not allocate.
  void evaluate(double time, Reference & reference) const;

private:
  void estimate_velocities(std::size_t point);

  std::vector<double> times_;  // [s] of the points; the first, at 0, is the reference at the start
  std::vector<Reference> points_;
  bool has_velocities_ = false;
  bool has_accelerations_ = false;
};

}  // namespace signid_controller
