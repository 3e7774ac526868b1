#pragma once
#include <cstdint>
#include <string>
#include <vector>
namespace trajectory_msgs::msg
{
struct JointTrajectory
{
  struct Point
  {
    std::vector<double> positions, velocities, accelerations;
    struct {std::int32_t sec; std::uint32_t nanosec;} time_from_start;
  };
  std::vector<std::string> joint_names;
  std::vector<Point> points;
};
}  // namespace trajectory_msgs::msg
