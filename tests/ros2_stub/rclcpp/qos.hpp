#pragma once
namespace rclcpp
{
struct QoS {};
struct SystemDefaultsQoS : QoS {};
}  // namespace rclcpp
