// The part of ros2_control's interface (Humble and later) that the example uses, for tests without ROS.
#pragma once
#include <map>
#include <memory>
#include <string>
#include <vector>
namespace rclcpp
{
struct Time {};
struct Duration {};
struct Parameter
{
  std::vector<std::string> names;
  double number = 0.0;
  std::vector<std::string> as_string_array() const { return names; }
  double as_double() const { return number; }
};
}  // namespace rclcpp
namespace rclcpp_lifecycle
{
struct State {};
struct LifecycleNode
{
  std::map<std::string, rclcpp::Parameter> parameters;
  rclcpp::Parameter get_parameter(const std::string & name) const { return parameters.at(name); }
};
}  // namespace rclcpp_lifecycle
namespace controller_interface
{
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration
{
  interface_configuration_type type;
  std::vector<std::string> names;
};
struct Interface
{
  double value = 0.0;
  double get_value() const { return value; }
  void set_value(double x) { value = x; }
};
class ControllerInterface
{
public:
  virtual ~ControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual return_type update(const rclcpp::Time &, const rclcpp::Duration &) = 0;
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node; }
  template <typename T>
  void auto_declare(const std::string & name, const T &) { node->parameters.emplace(name, rclcpp::Parameter{}); }
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node = std::make_shared<rclcpp_lifecycle::LifecycleNode>();
  std::vector<Interface> state_interfaces_, command_interfaces_;
};
}  // namespace controller_interface
