// The part of ros2_control's interface (Jazzy and later) that the controller uses, for tests without ROS.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>
#include "rclcpp/subscription.hpp"
namespace rclcpp
{
struct QoS;
struct Time {};
struct Duration
{
  double span = 0.0;
  double seconds() const {return span;}
};
using Value = std::variant<std::string, std::int64_t, double, std::vector<std::string>, std::vector<double>>;
struct Parameter
{
  Value value;
  template <typename T>
  T get_value() const
  {
    if (!std::holds_alternative<T>(value)) {throw std::runtime_error("parameter of another type");}
    return std::get<T>(value);
  }
  std::vector<std::string> as_string_array() const {return get_value<std::vector<std::string>>();}
  std::vector<double> as_double_array() const {return get_value<std::vector<double>>();}
  double as_double() const {return get_value<double>();}
};
}  // namespace rclcpp
namespace rclcpp_lifecycle
{
struct State
{
  std::uint8_t number = 1;
  std::uint8_t id() const {return number;}
};
struct LifecycleNode
{
  std::map<std::string, rclcpp::Value> overrides;
  std::map<std::string, rclcpp::Parameter> declared;
  std::map<std::string, std::shared_ptr<void>> subscriptions;
  bool has_parameter(const std::string & name) const {return declared.count(name) > 0;}
  rclcpp::Parameter get_parameter(const std::string & name) const {return declared.at(name);}
  template <typename T>
  T declare_parameter(const std::string & name, const T & standard)
  {
    const rclcpp::Parameter given{overrides.count(name) ? overrides.at(name) : rclcpp::Value(standard)};
    const T value = given.get_value<T>();
    declared[name] = given;
    return value;
  }
  int get_logger() const {return 0;}
  template <typename M, typename F>
  typename rclcpp::Subscription<M>::SharedPtr create_subscription(const std::string & topic, const rclcpp::QoS &, F && f)
  {
    auto made = std::make_shared<rclcpp::Subscription<M>>();
    made->callback = f;
    subscriptions[topic] = made;
    return made;
  }
};
}  // namespace rclcpp_lifecycle
namespace hardware_interface
{
class LoanedStateInterface
{
public:
  explicit LoanedStateInterface(std::shared_ptr<double> shared) : shared_(shared) {}
  LoanedStateInterface(const LoanedStateInterface &) = delete;
  LoanedStateInterface(LoanedStateInterface &&) = default;
  [[deprecated]] double get_value() const {return *shared_;}
  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int = 10) const
  {
    return contended ? std::nullopt : std::optional<T>(*shared_);
  }
  static inline bool contended = false;

private:
  std::shared_ptr<double> shared_;
};
class LoanedCommandInterface
{
public:
  explicit LoanedCommandInterface(std::shared_ptr<double> shared) : shared_(shared) {}
  LoanedCommandInterface(const LoanedCommandInterface &) = delete;
  LoanedCommandInterface(LoanedCommandInterface &&) = default;
  template <typename T>
  [[nodiscard]] bool set_value(const T & value, unsigned int = 10)
  {
    *shared_ = value;
    return true;
  }

private:
  std::shared_ptr<double> shared_;
};
}  // namespace hardware_interface
namespace controller_interface
{
enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };
struct InterfaceConfiguration
{
  interface_configuration_type type;
  std::vector<std::string> names = {};
};
class ControllerInterface
{
public:
  virtual ~ControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) {return CallbackReturn::SUCCESS;}
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) {return CallbackReturn::SUCCESS;}
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) {return CallbackReturn::SUCCESS;}
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual return_type update(const rclcpp::Time &, const rclcpp::Duration &) = 0;
  void assign_interfaces(
    std::vector<hardware_interface::LoanedCommandInterface> && commands,
    std::vector<hardware_interface::LoanedStateInterface> && states)
  {
    command_interfaces_ = std::move(commands);
    state_interfaces_ = std::move(states);
  }
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() {return node_;}
  const rclcpp_lifecycle::State & get_lifecycle_state() const {return state;}
  template <typename T>
  auto auto_declare(const std::string & name, const T & standard)
  {
    return node_->has_parameter(name) ? node_->get_parameter(name).get_value<T>()
                                      : node_->declare_parameter<T>(name, standard);
  }
  rclcpp_lifecycle::State state;

protected:
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;

private:
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_ = std::make_shared<rclcpp_lifecycle::LifecycleNode>();
};
}  // namespace controller_interface
