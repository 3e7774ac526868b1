#pragma once
#include <functional>
#include <mutex>
#include <type_traits>
namespace realtime_tools
{
template <class T>
class RealtimeThreadSafeBox
{
  static_assert(std::is_copy_constructible_v<T>);

public:
  bool try_set(const T & value)
  {
    return try_set([&value](T & held) {held = value;});
  }
  bool try_set(const std::function<void(T &)> & f)
  {
    std::unique_lock<std::mutex> guard(lock_, std::defer_lock);
    if (!guard.try_lock()) {return false;}
    f(value_);
    return true;
  }
  void set(const T & value)
  {
    set([&value](T & held) {held = value;});
  }
  template <typename F, typename = std::enable_if_t<std::is_invocable_v<F, T &> && !std::is_invocable_v<F, T>>>
  void set(F && f)
  {
    std::lock_guard<std::mutex> guard(lock_);
    f(value_);
  }

private:
  T value_{};
  std::mutex lock_;
};
}  // namespace realtime_tools
