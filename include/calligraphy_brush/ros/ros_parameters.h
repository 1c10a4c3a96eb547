#pragma once

#include <ros/node_handle.h>
#include <ros/param.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <algorithm>
#include <cstddef>
#include <exception>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

#include "calligraphy_brush/common/parameters.h"

/// Loads any described parameter struct from the ROS parameter server.
namespace calligraphy_brush {

namespace ros_parameters_detail {

using Leaves = std::map<std::string, XmlRpc::XmlRpcValue>;

/// All values below `tree` that are not groups, by full name.
inline void collectLeaves(XmlRpc::XmlRpcValue& tree, const std::string& name, Leaves& leaves) {
  if (tree.getType() != XmlRpc::XmlRpcValue::TypeStruct) {
    if (!name.empty()) leaves[name] = tree;
    return;
  }
  for (auto& member : tree)
    collectLeaves(member.second, name.empty() ? member.first : name + "/" + member.first, leaves);
}

inline std::string toText(XmlRpc::XmlRpcValue& value) {
  std::ostringstream text;
  value.write(text);
  return text.str();
}

// One overload for each type of field; false if the value is of another type.
inline bool convert(XmlRpc::XmlRpcValue& value, double& field) {
  if (value.getType() == XmlRpc::XmlRpcValue::TypeDouble) {
    field = static_cast<double&>(value);
    return true;
  }
  if (value.getType() == XmlRpc::XmlRpcValue::TypeInt) {
    field = static_cast<int&>(value);
    return true;
  }
  // YAML 1.1, which roslaunch and rosparam read, takes 30e-6 for text: it wants 30.0e-6.
  if (value.getType() != XmlRpc::XmlRpcValue::TypeString) return false;
  const std::string& text = static_cast<std::string&>(value);
  try {
    std::size_t end = 0;
    const double number = std::stod(text, &end);
    if (end != text.size()) return false;
    field = number;
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

inline bool convert(XmlRpc::XmlRpcValue& value, int& field) {
  if (value.getType() != XmlRpc::XmlRpcValue::TypeInt) return false;
  field = static_cast<int&>(value);
  return true;
}

inline bool convert(XmlRpc::XmlRpcValue& value, bool& field) {
  if (value.getType() != XmlRpc::XmlRpcValue::TypeBoolean) return false;
  field = static_cast<bool&>(value);
  return true;
}

inline bool convert(XmlRpc::XmlRpcValue& value, std::string& field) {
  if (value.getType() != XmlRpc::XmlRpcValue::TypeString) return false;
  field = static_cast<std::string&>(value);
  return true;
}

template <class Field>
const char* typeName() {
  if constexpr (std::is_same_v<Field, bool>) return "true or false";
  if constexpr (std::is_same_v<Field, std::string>) return "text";
  if constexpr (std::is_same_v<Field, int>) return "a whole number";
  return "a number";
}

}  // namespace ros_parameters_detail

/// Parameters from a tree of values as the parameter server holds it, below the name `ns`; what is
/// not there keeps its default.
///
/// A whole number is taken for a real one. Throws ParameterError with one line, full name, for each
/// value that is out of range or of a wrong type, and for each name within a group of the table that
/// the table does not have. Names outside those groups belong to others and are left alone.
template <class Parameters>
Parameters readParameters(XmlRpc::XmlRpcValue tree, const std::string& ns) {
  namespace detail = ros_parameters_detail;
  detail::Leaves leaves;
  detail::collectLeaves(tree, "", leaves);

  Parameters parameters;
  std::vector<std::string> problems;
  std::set<std::string> groups;
  visitParameters(parameters, [&](const std::string& name, auto& field, const auto& legal,
                                  const char* unit, const char*) {
    if (name.find('/') != std::string::npos) groups.insert(name.substr(0, name.find('/')));
    const auto leaf = leaves.find(name);
    if (leaf == leaves.end()) return;
    using Field = std::remove_reference_t<decltype(field)>;
    if (!detail::convert(leaf->second, field))
      problems.push_back(name + " = " + detail::toText(leaf->second) + " is not " +
                         detail::typeName<Field>() + ", legal are " +
                         parameters_detail::rangeText(legal) +
                         (std::string(unit) == "1" ? "" : " " + std::string(unit)));
    leaves.erase(leaf);
  });
  for (auto& [name, value] : leaves)
    if (groups.count(name) != 0)
      problems.push_back(name + " = " + detail::toText(value) + " is not a group of parameters");
    else if (groups.count(name.substr(0, name.find('/'))) != 0)
      problems.push_back(name + " = " + detail::toText(value) + " is not a known parameter");

  const auto out_of_range = findParameterProblems(parameters);
  problems.insert(problems.end(), out_of_range.begin(), out_of_range.end());
  std::sort(problems.begin(), problems.end());
  for (auto& problem : problems) problem.insert(0, ns + "/");
  if (!problems.empty()) throw ParameterError(problems);
  return parameters;
}

/// readParameters of what the parameter server holds below a private node handle.
template <class Parameters>
Parameters readParameters(const ros::NodeHandle& private_node) {
  XmlRpc::XmlRpcValue tree;
  ros::param::get(private_node.getNamespace(), tree);
  return readParameters<Parameters>(tree, private_node.getNamespace());
}

}  // namespace calligraphy_brush
