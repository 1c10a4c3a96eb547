#pragma once

#include <calligraphy_brush/ParameterValues.h>
#include <ros/ros.h>
#include <rviz/tool.h>

#include <Eigen/Core>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "calligraphy_brush/tablet/pointer_brush.h"

namespace rviz {
class BillboardLine;
class FloatProperty;
class Shape;
class StringProperty;
}  // namespace rviz

namespace calligraphy_brush {

/// "Brush": writes with the mouse on the sheet of a brush_simulator.
///
/// The left button presses, the wheel sets how hard, shift presses harder and ctrl lighter; the middle
/// and the right one move the view as ever. What mouse and poses have to do with each other is in
/// PointerBrush; brush and sheet are what the simulator says on brush_parameters. Poses come from a
/// thread of its own: a window that draws takes its time.
class BrushTool : public rviz::Tool {
  Q_OBJECT
 public:
  BrushTool();
  ~BrushTool() override;

  void activate() override;
  void deactivate() override;
  int processMouseEvent(rviz::ViewportMouseEvent& event) override;
  int processKeyEvent(QKeyEvent* event, rviz::RenderPanel* panel) override;
  void update(float wall_dt, float ros_dt) override;

 protected:
  void onInitialize() override;

 private Q_SLOTS:
  void connectTopics();
  void makeBrush();

 private:
  void receiveParameters(const ParameterValuesConstPtr& message);
  std::optional<Eigen::Vector2d> placeUnder(rviz::ViewportMouseEvent& event);
  void tell(const Eigen::Vector2d& place);
  double wantedPressure() const;
  void showCursor();
  void showStatus();
  void publish(const std::vector<HandlePose>& poses);
  void writePoses();

  rviz::StringProperty* topic_property_;
  rviz::FloatProperty* pressure_property_;
  rviz::FloatProperty* wheel_property_;
  rviz::FloatProperty* shift_property_;
  rviz::FloatProperty* control_property_;
  std::vector<std::function<void(PointerBrushParameters&)>> readers_;  // of the other properties

  // The cursor: a ring as wide as the root of the tuft, a disc the larger the harder it presses.
  std::unique_ptr<rviz::BillboardLine> ring_;
  std::unique_ptr<rviz::Shape> disc_;
  double root_diameter_ = 0.008;  // [m]

  ros::NodeHandle node_;
  ros::Subscriber parameter_subscriber_;
  std::vector<std::string> parameter_values_;
  std::optional<BrushOnSheet> sheet_;  // once the simulator has told

  bool is_active_ = false;
  bool presses_ = false;                  // the left button is down
  double modifier_ = 1.0;                 // of shift and ctrl
  std::optional<Eigen::Vector2d> place_;  // on the sheet, if the mouse is over its plane

  std::mutex mutex_;  // of what follows
  std::condition_variable wake_;
  ros::Publisher publisher_;
  std::string frame_ = "paper";
  std::unique_ptr<PointerBrush> mouse_;
  bool is_closing_ = false;
  std::thread writer_;  // last: it uses the others
};

}  // namespace calligraphy_brush
