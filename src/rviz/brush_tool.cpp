#include "brush_tool.h"

#include <OgrePlane.h>
#include <OgreQuaternion.h>
#include <OgreSceneNode.h>
#include <geometry_msgs/PoseStamped.h>
#include <rviz/display_context.h>
#include <rviz/frame_manager.h>
#include <rviz/geometry.h>
#include <rviz/ogre_helpers/billboard_line.h>
#include <rviz/ogre_helpers/ogre_vector.h>
#include <rviz/ogre_helpers/shape.h>
#include <rviz/properties/float_property.h>
#include <rviz/properties/string_property.h>
#include <rviz/render_panel.h>
#include <rviz/view_controller.h>
#include <rviz/viewport_mouse_event.h>

#include <QGuiApplication>
#include <QKeyEvent>
#include <QPainter>
#include <QPainterPath>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <pluginlib/class_list_macros.hpp>

#include "calligraphy_brush/ros/conversions.h"
#include "calligraphy_brush/ros/tablet_driver.h"

namespace calligraphy_brush {
namespace {

constexpr std::uint32_t kPoseQueue = 10000;
constexpr float kAboveSheet = 0.0004F;  // [m]: so that ink does not hide the cursor
constexpr float kNotch = 120.0F;        // of a wheel, as Qt counts

std::int64_t now_ns() {
  return toNanoseconds(ros::Time::now());
}

/// A brush, drawn: there is no folder of icons.
QPixmap drawIcon() {
  QPixmap icon(32, 32);
  icon.fill(Qt::transparent);
  QPainter painter(&icon);
  painter.setRenderHint(QPainter::Antialiasing);
  painter.translate(16, 16);
  painter.rotate(35);
  painter.setPen(Qt::NoPen);
  painter.setBrush(QColor(184, 148, 92));
  painter.drawRoundedRect(QRectF(-2, -16, 4, 17), 1.5, 1.5);
  painter.setBrush(QColor(90, 60, 45));
  painter.drawRect(QRectF(-2.6, 0, 5.2, 4));
  QPainterPath tuft(QPointF(-2.6, 4));
  tuft.cubicTo(-4.5, 9, -2, 12, 0, 15.5);
  tuft.cubicTo(2, 12, 4.5, 9, 2.6, 4);
  painter.setBrush(QColor(25, 22, 28));
  painter.drawPath(tuft);
  return icon;
}

}  // namespace

BrushTool::BrushTool() {
  shortcut_key_ = 'b';
  rviz::Property* root = getPropertyContainer();
  const auto number = [](const char* name, double value, Range<double> range, const char* description,
                         rviz::Property* parent) {
    auto* property = new rviz::FloatProperty(name, static_cast<float>(value), description, parent);
    property->setMin(static_cast<float>(range.low));
    property->setMax(static_cast<float>(range.high));
    return property;
  };
  pressure_property_ = number("Pressure", 0.6, {0.02, 1.0},
                              "Of the left button, over the full one; the wheel changes it.", root);
  wheel_property_ = number("Wheel", 0.05, {0.0, 1.0},
                           "By how much one notch of the wheel changes the pressure.", root);
  shift_property_ =
      number("Shift", 1.6, {0.0, 10.0}, "Pressure with the shift key over that without.", root);
  control_property_ =
      number("Ctrl", 0.4, {0.0, 10.0}, "Pressure with the ctrl key over that without.", root);
  topic_property_ = new rviz::StringProperty(
      "Topic", "handle_pose",
      "Where the poses go; brush and sheet are those of brush_parameters in the same namespace.", root,
      SLOT(connectTopics()), this);

  // The rest is a table of parameters already: name, value, range and text are in it.
  auto* more = new rviz::Property("Motion and grip", QVariant(), "How the mouse becomes a brush.", root);
  const PointerBrushParameters defaults;
  visitParameters(defaults, [&](const std::string& name, const double& field, const Range<double>& range,
                                const char* unit, const char* description) {
    const std::string text =
        std::string(description) + (std::string(unit) == "1" ? "" : " [" + std::string(unit) + "]");
    auto* property = number(name.c_str(), field, range, text.c_str(), more);
    connect(property, SIGNAL(changed()), this, SLOT(makeBrush()));
    const double value = field;
    readers_.push_back([property, name, value](PointerBrushParameters& parameters) {
      visitParameters(parameters, [&](const std::string& other, double& target,
                                      const Range<double>& legal, const char*, const char*) {
        if (other != name) return;
        // A property is a float: what nobody has changed keeps its bits, what is at the end of the range
        // stays inside.
        const float shown = property->getFloat();
        target = shown == static_cast<float>(value)
                     ? value
                     : std::clamp(static_cast<double>(shown), legal.low, legal.high);
      });
    });
  });
}

BrushTool::~BrushTool() {
  if (!writer_.joinable()) return;  // It was never shown.
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    is_closing_ = true;
  }
  wake_.notify_all();
  writer_.join();
}

void BrushTool::onInitialize() {
  setName("Brush");
  setIcon(QIcon(drawIcon()));
  setCursor(QCursor(Qt::CrossCursor));
  ring_ = std::make_unique<rviz::BillboardLine>(scene_manager_);
  disc_ = std::make_unique<rviz::Shape>(rviz::Shape::Cylinder, scene_manager_);
  // A cylinder of Ogre's lies along y.
  showCursor();
  connectTopics();
  writer_ = std::thread([this] { writePoses(); });
}

void BrushTool::connectTopics() {
  if (scene_manager_ == nullptr) return;
  const std::string topic = topic_property_->getStdString();
  const auto slash = topic.rfind('/');
  const std::string ns = slash == std::string::npos ? "" : topic.substr(0, slash + 1);
  deactivate();
  sheet_.reset();
  parameter_values_.clear();
  try {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      mouse_.reset();
      publisher_.shutdown();
      publisher_ = node_.advertise<geometry_msgs::PoseStamped>(topic, kPoseQueue);
    }
    parameter_subscriber_ =
        node_.subscribe(ns + "brush_parameters", 1, &BrushTool::receiveParameters, this);
  } catch (const ros::InvalidNameException& error) {
    setStatus(QString("Brush: ") + error.what());
  }
}

void BrushTool::receiveParameters(const ParameterValuesConstPtr& message) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    frame_ = message->header.frame_id;
  }
  if (message->values == parameter_values_) return;
  parameter_values_ = message->values;
  try {
    const SimulatorParameters parameters = toSimulatorParameters(*message);
    sheet_ = measureBrush(parameters);
    root_diameter_ = parameters.brush.root_diameter;
  } catch (const std::exception& error) {
    sheet_.reset();
    ROS_ERROR_STREAM("Brush: what the simulator says of itself is not understood:\n" << error.what());
  }
  makeBrush();
}

/// With the parameters as they are now; a stroke that is being written ends.
void BrushTool::makeBrush() {
  std::vector<HandlePose> last;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (mouse_) last = mouse_->leave(now_ns());
    publish(last);
    mouse_.reset();
    if (!sheet_) return;
    PointerBrushParameters parameters;
    for (const auto& read : readers_) read(parameters);
    mouse_ = std::make_unique<PointerBrush>(parameters, *sheet_);
  }
  showStatus();
}

// ---------------------------------------------------------------- mouse

void BrushTool::activate() {
  is_active_ = true;
  showStatus();
}

void BrushTool::deactivate() {
  is_active_ = presses_ = false;
  place_.reset();
  showCursor();
  const std::lock_guard<std::mutex> lock(mutex_);
  if (mouse_ && mouse_->isInUse()) publish(mouse_->leave(now_ns()));
}

/// Where on the sheet the mouse is [m]; nothing if its plane is not under it.
std::optional<Eigen::Vector2d> BrushTool::placeUnder(rviz::ViewportMouseEvent& event) {
  std::string frame;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    frame = frame_;
  }
  Ogre::Vector3 origin;
  Ogre::Quaternion turn;
  if (!context_->getFrameManager()->getTransform(frame, ros::Time(), origin, turn)) {
    setStatus(QString::fromStdString("Brush: no way from frame " + frame + " to the fixed frame"));
    return std::nullopt;
  }
  Ogre::Plane sheet(turn * Ogre::Vector3::UNIT_Z, origin);
  Ogre::Vector3 hit;
  if (!rviz::getPointOnPlaneFromWindowXY(event.viewport, sheet, event.x, event.y, hit))
    return std::nullopt;
  const Ogre::Vector3 p = turn.Inverse() * (hit - origin);
  const Eigen::Vector2d place(p.x, p.y);
  if (!place.allFinite()) return std::nullopt;
  return place;
}

int BrushTool::processMouseEvent(rviz::ViewportMouseEvent& event) {
  const bool moves_view = event.middle() || event.right() || event.middleUp() || event.rightUp();
  if (moves_view && !presses_) {
    if (event.panel->getViewController() != nullptr)
      event.panel->getViewController()->handleMouseEvent(event);
    return 0;
  }
  if (!sheet_) {
    showStatus();
    return 0;
  }
  modifier_ = (event.shift() ? shift_property_->getFloat() : 1.0) *
              (event.control() ? control_property_->getFloat() : 1.0);
  if (event.type == QEvent::Wheel)
    pressure_property_->add(wheel_property_->getFloat() * static_cast<float>(event.wheel_delta) /
                            kNotch);
  presses_ = event.left();
  place_ = placeUnder(event);
  if (place_) {
    tell(*place_);
  } else {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (mouse_) mouse_->release(now_ns());
  }
  showCursor();
  showStatus();
  return Render;
}

int BrushTool::processKeyEvent(QKeyEvent* event, rviz::RenderPanel* /*panel*/) {
  if (event->key() == Qt::Key_Escape) Q_EMIT close();
  return 0;
}

/// Keys are let go without an event of the mouse.
void BrushTool::update(float /*wall_dt*/, float /*ros_dt*/) {
  if (!presses_ || !place_) return;
  const auto keys = QGuiApplication::queryKeyboardModifiers();
  const double modifier = (keys.testFlag(Qt::ShiftModifier) ? shift_property_->getFloat() : 1.0) *
                          (keys.testFlag(Qt::ControlModifier) ? control_property_->getFloat() : 1.0);
  if (modifier == modifier_) return;
  modifier_ = modifier;
  tell(*place_);
  showCursor();
}

double BrushTool::wantedPressure() const {
  return std::min(1.0, modifier_ * static_cast<double>(pressure_property_->getFloat()));
}

void BrushTool::tell(const Eigen::Vector2d& place) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!mouse_) return;
    mouse_->point(now_ns(), place, presses_ ? wantedPressure() : 0.0);
  }
  wake_.notify_all();
}

// ---------------------------------------------------------------- what is seen

void BrushTool::showCursor() {
  const bool is_seen = is_active_ && place_.has_value();
  ring_->getSceneNode()->setVisible(is_seen);
  disc_->getRootNode()->setVisible(is_seen);
  if (!is_seen) return;
  std::string frame;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    frame = frame_;
  }
  Ogre::Vector3 origin;
  Ogre::Quaternion turn;
  if (!context_->getFrameManager()->getTransform(frame, ros::Time(), origin, turn)) return;
  const Ogre::Vector3 place(static_cast<float>(place_->x()), static_cast<float>(place_->y()),
                            kAboveSheet);

  constexpr int corners = 48;
  const auto radius = static_cast<float>(0.5 * root_diameter_);
  ring_->clear();
  ring_->setMaxPointsPerLine(corners + 1);
  ring_->setLineWidth(0.0006F);
  if (presses_)
    ring_->setColor(0.75F, 0.1F, 0.08F, 1.0F);
  else
    ring_->setColor(0.15F, 0.3F, 0.7F, 1.0F);
  for (int k = 0; k <= corners; ++k) {
    const float angle = 6.2831853F * static_cast<float>(k) / corners;
    ring_->addPoint({radius * std::cos(angle), radius * std::sin(angle), 0.0F});
  }
  ring_->setPosition(origin + turn * place);
  ring_->setOrientation(turn);

  const auto size = static_cast<float>(root_diameter_ * wantedPressure());
  disc_->setColor(presses_ ? 0.75F : 0.15F, presses_ ? 0.1F : 0.3F, presses_ ? 0.08F : 0.7F, 0.35F);
  disc_->setScale({size, 0.0001F, size});
  disc_->setPosition(origin + turn * place);
  disc_->setOrientation(turn * Ogre::Quaternion(Ogre::Degree(90), Ogre::Vector3::UNIT_X));
}

void BrushTool::showStatus() {
  if (!is_active_) return;
  if (!sheet_) {
    setStatus("Brush: waiting for brush_parameters of a brush_simulator");
    return;
  }
  setStatus(
      QString("<b>Left:</b> write. <b>Wheel:</b> pressure, now %1. <b>Shift/Ctrl:</b> harder/lighter. "
              "<b>Middle/Right:</b> view.")
          .arg(wantedPressure(), 0, 'f', 2));
}

// ---------------------------------------------------------------- poses

/// With the mutex held.
void BrushTool::publish(const std::vector<HandlePose>& poses) {
  for (const HandlePose& pose : poses) publisher_.publish(toPoseStamped(pose, frame_));
}

void BrushTool::writePoses() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!is_closing_) {
    if (!mouse_ || !mouse_->isInUse()) {
      wake_.wait(lock, [this] { return is_closing_ || (mouse_ && mouse_->isInUse()); });
      continue;
    }
    publish(mouse_->advanceTo(now_ns()));
    wake_.wait_for(lock, std::chrono::milliseconds(4), [this] { return is_closing_; });
  }
}

}  // namespace calligraphy_brush

PLUGINLIB_EXPORT_CLASS(calligraphy_brush::BrushTool, rviz::Tool)
