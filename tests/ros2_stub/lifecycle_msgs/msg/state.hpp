#pragma once
#include <cstdint>
namespace lifecycle_msgs::msg
{
struct State {static constexpr std::uint8_t PRIMARY_STATE_INACTIVE = 2, PRIMARY_STATE_ACTIVE = 3;};
}  // namespace lifecycle_msgs::msg
