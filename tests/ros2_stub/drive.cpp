// Drives the controller by the words of standard input, on a robot with the dynamics of arm.h, and prints what it does.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <new>
#include "arm.h"
#include "inverse_dynamics_controller.hpp"
#include "lifecycle_msgs/msg/state.hpp"

static bool counting = false;
static int allocations = 0;  // in update
void * operator new(std::size_t size)
{
  allocations += counting;
  return std::malloc(size);
}
void operator delete(void * p) noexcept
{
  allocations += counting;
  std::free(p);
}
void operator delete(void * p, std::size_t) noexcept {operator delete(p);}

namespace
{
constexpr std::size_t n = SIGNID_JOINTS;
constexpr double kPeriod = 1e-3;  // [s]
using Shared = std::vector<std::shared_ptr<double>>;

template <typename T>
T read()
{
  T value;
  std::cin >> value;
  return value;
}

template <>
double read<double>() {return std::strtod(read<std::string>().c_str(), nullptr);}

template <typename T>
std::vector<T> list()
{
  std::vector<T> values(read<std::size_t>());
  for (auto & value : values) {value = read<T>();}
  return values;
}

rclcpp::Value parameter()
{
  const auto type = read<std::string>();
  if (type == "strings") {return list<std::string>();}
  if (type == "numbers") {return list<double>();}
  if (type == "number") {return read<double>();}
  if (type == "integer") {return read<std::int64_t>();}
  return read<std::string>();
}

trajectory_msgs::msg::JointTrajectory trajectory()
{
  trajectory_msgs::msg::JointTrajectory message;
  message.joint_names = list<std::string>();
  message.points.resize(read<std::size_t>());
  for (auto & point : message.points) {
    const double time = read<double>(), whole = std::floor(time);
    point.time_from_start = {std::int32_t(whole), std::uint32_t(std::lround(1e9 * (time - whole)))};
    point.positions = list<double>();
    point.velocities = list<double>();
    point.accelerations = list<double>();
  }
  return message;
}

// One period of the robot: M(q) a = tau - inverse_dynamics(q, v, 0).
void move(Shared & states, const Shared & efforts)
{
  for (int part = 0; part < 10; ++part) {
    double q[n], v[n], none[n] = {}, a[n], bias[n], mass[n * n];
    for (std::size_t j = 0; j < n; ++j) {q[j] = *states[2 * j], v[j] = *states[2 * j + 1];}
    signid_inverse_dynamics(q, v, none, bias);
    signid_mass_matrix(q, mass);
    for (std::size_t j = 0; j < n; ++j) {a[j] = *efforts[j] - bias[j];}
    for (std::size_t k = 0; k < n; ++k) {
      for (std::size_t i = k + 1; i < n; ++i) {
        const double share = mass[i * n + k] / mass[k * n + k];
        for (std::size_t j = k; j < n; ++j) {mass[i * n + j] -= share * mass[k * n + j];}
        a[i] -= share * a[k];
      }
    }
    for (std::size_t k = n; k-- > 0;) {
      for (std::size_t j = k + 1; j < n; ++j) {a[k] -= mass[k * n + j] * a[j];}
      a[k] /= mass[k * n + k];
      *states[2 * k + 1] += 0.1 * kPeriod * a[k];
      *states[2 * k] += 0.1 * kPeriod * *states[2 * k + 1];
    }
  }
}
}  // namespace

int main()
{
  using lifecycle_msgs::msg::State;
  signid_controller::InverseDynamicsController controller;
  Shared states(2 * n), efforts(n);
  std::vector<hardware_interface::LoanedStateInterface> read_by;
  std::vector<hardware_interface::LoanedCommandInterface> set_by;
  for (auto & x : states) {read_by.emplace_back(x = std::make_shared<double>(0.0));}
  for (auto & x : efforts) {set_by.emplace_back(x = std::make_shared<double>(0.0));}
  controller.assign_interfaces(std::move(set_by), std::move(read_by));
  const auto done = [](controller_interface::CallbackReturn x) {std::printf("%d\n", int(x));};
  const auto show = [&](int result) {
    std::printf("%d %d", result, allocations);
    for (const auto & x : states) {std::printf(" %.17g", *x);}
    for (const auto & x : efforts) {std::printf(" %.17g", *x);}
    std::printf("\n");
  };
  const auto update = [&]() {
    counting = true;
    const auto result = controller.update({}, {kPeriod});
    counting = false;
    show(int(result));
  };
  for (std::string word; std::cin >> word;) {
    if (word == "parameter") {
      const auto name = read<std::string>();
      controller.get_node()->overrides[name] = parameter();
    } else if (word == "init") {
      done(controller.on_init());
    } else if (word == "configure") {
      done(controller.on_configure({}));
    } else if (word == "activate") {
      controller.state.number = State::PRIMARY_STATE_ACTIVE;
      done(controller.on_activate({}));
    } else if (word == "deactivate") {
      controller.state.number = State::PRIMARY_STATE_INACTIVE;
      done(controller.on_deactivate({}));
    } else if (word == "interfaces") {
      for (const auto & name : controller.command_interface_configuration().names) {std::printf("%s ", name.c_str());}
      for (const auto & name : controller.state_interface_configuration().names) {std::printf("%s ", name.c_str());}
      std::printf("\n");
    } else if (word == "state") {
      for (auto & x : states) {*x = read<double>();}
    } else if (word == "contended") {
      hardware_interface::LoanedStateInterface::contended = read<int>() != 0;
    } else if (word == "trajectory") {
      using Subscription = rclcpp::Subscription<trajectory_msgs::msg::JointTrajectory>;
      const auto made = controller.get_node()->subscriptions.at("~/joint_trajectory");
      std::static_pointer_cast<Subscription>(made)->callback(trajectory());
    } else if (word == "show") {
      show(0);
    } else if (word == "update") {
      update();
    } else if (word == "run") {
      for (int k = read<int>(); k > 0; --k) {
        update();
        move(states, efforts);
      }
    } else {
      return 1;
    }
  }
  return 0;
}
