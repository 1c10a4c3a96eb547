#include "calligraphy_brush/tablet/tablet_decoder.h"

#include <linux/input-event-codes.h>

#include <cmath>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kMetresPerMillimetre = 1e-3;
constexpr double kGuessedWidth = 0.2;  // [m]

// A mouse (BTN_TOOL_MOUSE, BTN_TOOL_LENS) on a tablet is no brush, nor is a finger.
constexpr std::uint16_t kPens[] = {BTN_TOOL_PEN, BTN_TOOL_BRUSH, BTN_TOOL_PENCIL, BTN_TOOL_AIRBRUSH};

double extent(const TabletAxis& axis) {
  return static_cast<double>(axis.maximum) - axis.minimum;
}

/// Length of an axis [m]; 0 if it has no resolution.
double axisLength(const TabletAxis& axis) {
  return axis.resolution > 0 ? extent(axis) / axis.resolution * kMetresPerMillimetre : 0.0;
}

}  // namespace

TabletSize findTabletSize(const TabletDescription& description,
                          const TabletDeviceParameters& parameters) {
  const TabletAxis& x = description.axes.at(ABS_X);
  const TabletAxis& y = description.axes.at(ABS_Y);
  TabletSize size;
  size.width = parameters.width > 0.0 ? parameters.width : axisLength(x);
  size.height = parameters.height > 0.0 ? parameters.height : axisLength(y);
  size.is_known = size.width > 0.0 || size.height > 0.0;
  // With square units one side tells the other.
  if (!size.is_known) size.width = kGuessedWidth;
  if (size.width <= 0.0) size.width = size.height * extent(x) / extent(y);
  if (size.height <= 0.0) size.height = size.width * extent(y) / extent(x);
  return size;
}

TabletDecoder::TabletDecoder(const TabletDescription& description, const TabletParameters& parameters)
    : description_(description), parameters_(parameters) {
  checkParameters(parameters);
  if (!isPenTablet(description))
    throw std::invalid_argument("\"" + description.name + "\" is not a pen tablet");
  size_ = findTabletSize(description, parameters.device);
  has_tools_ = description.has(EV_KEY, BTN_TOOL_RUBBER);
  for (const std::uint16_t pen : kPens) has_tools_ = has_tools_ || description.has(EV_KEY, pen);
}

const TabletAxis* TabletDecoder::axis(std::uint16_t code) const {
  const auto found = description_.axes.find(code);
  return found == description_.axes.end() || extent(found->second) <= 0.0 ? nullptr : &found->second;
}

std::optional<double> TabletDecoder::partOfAxis(std::uint16_t code) const {
  const TabletAxis* a = axis(code);
  if (a == nullptr) return std::nullopt;
  const auto value = values_.find(code);
  return value == values_.end() ? 0.0 : a->part(value->second);
}

double TabletDecoder::tilt(std::uint16_t code) const {
  const TabletAxis& a = *axis(code);
  const std::int32_t value = values_.at(code);
  if (a.resolution > 0 && a.minimum < 0 && a.maximum > 0)
    return std::max(-0.5 * kPi, std::min(0.5 * kPi, static_cast<double>(value) / a.resolution));
  // The centre is a whole number: 64 of 0..127.
  const double part = (static_cast<double>(value) - a.minimum) / (extent(a) + 1.0);
  return parameters_.tilt.full_scale * std::max(-1.0, std::min(1.0, 2.0 * part - 1.0));
}

PenTool TabletDecoder::tool() const {
  // Some devices hold the pen's key while the other end is near: the eraser is what the hand meant.
  if (isDown(BTN_TOOL_RUBBER)) return PenTool::kEraser;
  for (const std::uint16_t pen : kPens)
    if (isDown(pen)) return PenTool::kPen;
  return has_tools_ ? PenTool::kNone : PenTool::kPen;
}

std::optional<PenSample> TabletDecoder::take(const InputEvent& event) {
  if (event.type == EV_SYN && event.code == SYN_DROPPED) {
    is_dropping_ = true;
    ++drop_count_;
    return std::nullopt;
  }
  const bool is_report = event.type == EV_SYN && event.code == SYN_REPORT;
  if (is_dropping_) {
    is_dropping_ = !is_report;
    return std::nullopt;
  }
  if (is_report) return report(event.stamp_ns);
  if (event.type == EV_KEY) {
    if (event.value != 0)
      keys_.insert(event.code);
    else
      keys_.erase(event.code);
  } else if (event.type == EV_ABS) {
    values_[event.code] = event.value;
    fresh_.insert(event.code);
  } else if (event.type == EV_MSC && event.code == MSC_SERIAL) {
    sample_.serial = static_cast<std::uint32_t>(event.value);
  }
  return std::nullopt;
}

PenSample TabletDecoder::report(std::int64_t stamp_ns) {
  sample_.stamp_ns = stamp_ns;
  sample_.tool = tool();
  if (sample_.tool == PenTool::kNone) {
    sample_.touching = sample_.stylus = sample_.stylus2 = sample_.stylus3 = false;
    sample_.pressure = 0.0;
    fresh_.clear();
    return sample_;
  }
  if (values_.count(ABS_X) != 0 && values_.count(ABS_Y) != 0) {
    sample_.has_position = true;
    sample_.x = size_.width * *partOfAxis(ABS_X);
    sample_.y = size_.height * (1.0 - *partOfAxis(ABS_Y));  // the kernel's y runs down
  }
  sample_.pressure = partOfAxis(ABS_PRESSURE).value_or(0.0);
  // A touch without pressure is a worn pen, or one about to leave; pressure without touch a noisy one.
  sample_.touching =
      sample_.pressure > 0.0 && (description_.has(EV_KEY, BTN_TOUCH) ? isDown(BTN_TOUCH) : true);
  sample_.distance = partOfAxis(ABS_DISTANCE);

  sample_.tilt_x.reset();
  sample_.tilt_y.reset();
  sample_.rotation.reset();
  sample_.wheel.reset();
  if (axis(ABS_TILT_X) != nullptr && axis(ABS_TILT_Y) != nullptr &&
      (fresh_.count(ABS_TILT_X) != 0 || fresh_.count(ABS_TILT_Y) != 0) &&
      values_.count(ABS_TILT_X) != 0 && values_.count(ABS_TILT_Y) != 0) {
    sample_.tilt_x = tilt(ABS_TILT_X);
    sample_.tilt_y = tilt(ABS_TILT_Y);
  }
  if (const TabletAxis* z = axis(ABS_Z); z != nullptr && fresh_.count(ABS_Z) != 0) {
    const double turns = (static_cast<double>(values_.at(ABS_Z)) - z->minimum) / (extent(*z) + 1.0);
    sample_.rotation = 2.0 * kPi * (turns + 0.25 - std::floor(turns + 0.25));
  }
  if (fresh_.count(ABS_WHEEL) != 0) sample_.wheel = partOfAxis(ABS_WHEEL);
  sample_.stylus = isDown(BTN_STYLUS);
  sample_.stylus2 = isDown(BTN_STYLUS2);
  sample_.stylus3 = isDown(BTN_STYLUS3);
  return sample_;
}

}  // namespace calligraphy_brush
