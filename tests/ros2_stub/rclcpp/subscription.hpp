#pragma once
#include <functional>
#include <memory>
namespace rclcpp
{
template <typename M>
struct Subscription
{
  using SharedPtr = std::shared_ptr<Subscription>;
  std::function<void(const M &)> callback;
};
}  // namespace rclcpp
