#pragma once
#include <type_traits>
#define PLUGINLIB_EXPORT_CLASS(a, b) static_assert(std::is_base_of_v<b, a> && std::is_default_constructible_v<a>);
