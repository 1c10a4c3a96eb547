#include <rviz/panel.h>
#include <rviz/properties/property.h>
#include <rviz/render_panel.h>
#include <rviz/tool.h>
#include <rviz/tool_manager.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>
#include <rviz/visualization_manager.h>
#include <sensor_msgs/Image.h>

#include <QApplication>
#include <QComboBox>
#include <QLabel>
#include <QLineEdit>
#include <QMouseEvent>
#include <QProgressBar>
#include <QPushButton>
#include <QWheelEvent>
#include <algorithm>
#include <cstdlib>
#include <memory>
#include <pluginlib/class_loader.hpp>
#include <string>
#include <vector>

#include "calligraphy_brush/files/png.h"
#include "calligraphy_brush/ros/simulator_client.h"
#include "child.h"
#include "ros_fixture.h"

// The plugins as rviz has them: loaded by name, drawn by OGRE on an X server of their own, and moved by
// Qt's events, beside a brush_simulator_node.

namespace calligraphy_brush {
namespace {

/// Lets windows and topics work until it is so.
bool workUntil(const std::function<bool()>& is_so) {
  return spinUntil([&] {
    QApplication::processEvents();
    return is_so();
  });
}
void workFor(double seconds) {
  const auto end = ros::WallTime::now() + ros::WallDuration(seconds);
  workUntil([&] { return ros::WallTime::now() > end; });
}

class Plugins : public testing::Test {
 protected:
  void SetUp() override {
    std_srvs::Trigger reset;
    ASSERT_TRUE(ros::service::waitForService("brush_simulator/reset", ros::Duration(kDeadline)));
    ASSERT_TRUE(ros::service::call("brush_simulator/reset", reset));
    ASSERT_TRUE(reset.response.success) << reset.response.message;
  }

  ros::NodeHandle node_;
  Listener<BrushState> state_{node_, "brush_state"};
};

// ---------------------------------------------------------------- tool

/// A window of rviz that looks straight down at the sheet, with the tool in hand.
class BrushToolPlugin : public Plugins {
 protected:
  static constexpr int kSize = 600;
  static constexpr double kPixel = 0.0005;  // [m]
  static constexpr double kMiddleX = 0.12, kMiddleY = 0.08;

  // rviz has one of these a process.
  static void SetUpTestSuite() {
    window_ = std::make_unique<rviz::RenderPanel>();
    window_->resize(kSize, kSize);
    window_->show();
    manager_ = std::make_unique<rviz::VisualizationManager>(window_.get());
    window_->initialize(manager_->getSceneManager(), manager_.get());
    manager_->initialize();
    manager_->setFixedFrame("paper");
    manager_->getViewManager()->setCurrentViewControllerType("rviz/TopDownOrtho");
    rviz::ViewController* view = manager_->getViewManager()->getCurrent();
    view->subProp("Scale")->setValue(1.0 / kPixel);
    view->subProp("X")->setValue(kMiddleX);
    view->subProp("Y")->setValue(kMiddleY);
    manager_->startUpdate();
  }
  static void TearDownTestSuite() {
    manager_.reset();
    window_.reset();
  }

  void SetUp() override {
    Plugins::SetUp();
    tool_ = manager_->getToolManager()->addTool("calligraphy_brush/Brush");
    ASSERT_EQ(tool_->getClassId(), "calligraphy_brush/Brush");
    ASSERT_EQ(tool_->getName(), "Brush") << "a tool that failed has another name";
    manager_->getToolManager()->setCurrentTool(tool_);
    // Upright: its point is under the handle.
    tool_->getPropertyContainer()->subProp("Motion and grip")->subProp("grip/tilt")->setValue(0.0);
    ASSERT_TRUE(workUntil([&] { return state_.newest != nullptr; }));
    // Until the tool has heard of the sheet, the mouse moves nothing.
    ASSERT_TRUE(workUntil([&] {
      point(0.05, 0.05, Qt::NoButton);
      workFor(0.02);
      return accepted_.count > 0;
    })) << "the tool publishes nothing";
  }
  void TearDown() override { manager_->getToolManager()->removeAll(); }

  QPoint pixelOf(double x, double y) const {
    return {static_cast<int>(std::lround(kSize / 2 + (x - kMiddleX) / kPixel)),
            static_cast<int>(std::lround(kSize / 2 - (y - kMiddleY) / kPixel))};
  }
  void send(QEvent::Type type, double x, double y, Qt::MouseButton button, Qt::MouseButtons down,
            Qt::KeyboardModifiers keys = Qt::NoModifier) {
    QMouseEvent event(type, pixelOf(x, y), button, down, keys);
    QApplication::sendEvent(window_.get(), &event);
  }
  void point(double x, double y, Qt::MouseButtons down) {
    send(QEvent::MouseMove, x, y, Qt::NoButton, down);
  }
  /// Drags evenly over the sheet, an event every 15 ms.
  void drag(double from_x, double to_x, double y, Qt::MouseButtons down, double seconds) {
    const int count = static_cast<int>(seconds / 0.015);
    for (int k = 1; k <= count; ++k) {
      point(from_x + (to_x - from_x) * k / count, y, down);
      workFor(0.015);
    }
  }
  static double height(const geometry_msgs::PoseStamped& pose) { return pose.pose.position.z - 0.045; }

  static std::unique_ptr<rviz::RenderPanel> window_;
  static std::unique_ptr<rviz::VisualizationManager> manager_;
  rviz::Tool* tool_ = nullptr;
  Listener<geometry_msgs::PoseStamped> accepted_{node_, "accepted_pose"};
};

std::unique_ptr<rviz::RenderPanel> BrushToolPlugin::window_;
std::unique_ptr<rviz::VisualizationManager> BrushToolPlugin::manager_;

TEST_F(BrushToolPlugin, WritesWhereTheMouseIsDragged) {
  Listener<sensor_msgs::Image> image(node_, "stroke_image");
  std::vector<geometry_msgs::PoseStamped> poses;
  const auto takes = node_.subscribe<geometry_msgs::PoseStamped>(
      "accepted_pose", 10000,
      [&](const geometry_msgs::PoseStampedConstPtr& pose) { poses.push_back(*pose); });
  ASSERT_TRUE(workUntil([&] { return takes.getNumPublishers() > 0 && image.newest; }));
  drag(0.05, 0.06, 0.08, Qt::NoButton, 0.3);
  send(QEvent::MouseButtonPress, 0.06, 0.08, Qt::LeftButton, Qt::LeftButton);
  workFor(0.1);
  drag(0.06, 0.16, 0.08, Qt::LeftButton, 1.0);
  // It goes where the mouse is, pressed as the property says, in the frame that the simulator names.
  ASSERT_TRUE(
      workUntil([&] { return !poses.empty() && std::abs(poses.back().pose.position.x - 0.16) < 5e-4; }));
  EXPECT_NEAR(poses.back().pose.position.y, 0.08, 5e-4);
  const double pressure = tool_->getPropertyContainer()->subProp("Pressure")->getValue().toDouble();
  EXPECT_NEAR(height(poses.back()), -0.3 * 0.045 * (pressure - 0.01) / 0.99, 1e-4);
  EXPECT_EQ(poses.back().header.frame_id, "paper");
  send(QEvent::MouseButtonRelease, 0.16, 0.08, Qt::LeftButton, Qt::NoButton);
  ASSERT_TRUE(workUntil([&] { return height(poses.back()) > 0.004; })) << "not lifted";
  drag(0.16, 0.1, 0.12, Qt::NoButton, 0.3);

  // A steady rate, whatever the window does; but for the pose that ends a pause.
  int uneven = 0;
  for (std::size_t k = 1; k < poses.size(); ++k)
    uneven += (poses[k].header.stamp - poses[k - 1].header.stamp).toNSec() != 5'000'000;
  EXPECT_LE(uneven, 2) << "of " << poses.size();
  EXPECT_GT(poses.size(), 300U);
  EXPECT_EQ(state_.newest->poses_refused, 0U);

  // The ink: one line where the mouse was pressed.
  ASSERT_TRUE(workUntil([&] { return state_.newest->touching_rods == 0; }));
  workFor(0.2);
  int left = 100000, right = -1, top = 100000, bottom = -1;
  const int width = static_cast<int>(image.newest->width), rows = static_cast<int>(image.newest->height);
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < width; ++column)
      if (image.newest->data[static_cast<std::size_t>(row * width + column)] < 160) {
        left = std::min(left, column);
        right = std::max(right, column);
        top = std::min(top, row);
        bottom = std::max(bottom, row);
      }
  if (const char* folder = std::getenv("CALLIGRAPHY_PICTURES"))
    writePng(std::string(folder) + "/rviz_tool.png", width, rows, image.newest->data, 6.0);
  ASSERT_GE(right, 0) << "no ink";
  const double px_per_m = 6000.0;
  EXPECT_NEAR(left / px_per_m, 0.06, 0.012);
  EXPECT_NEAR(right / px_per_m, 0.16, 0.015);
  EXPECT_GT((right - left) / px_per_m, 0.09);
  // An upright tuft splays where it is set down.
  EXPECT_LT((bottom - top) / px_per_m, 0.02) << "not one line";
  EXPECT_NEAR((rows - 0.5 * (bottom + top)) / px_per_m, 0.08, 0.006);
}

TEST_F(BrushToolPlugin, TheWheelSaysHowHard) {
  rviz::Property* pressure = tool_->getPropertyContainer()->subProp("Pressure");
  pressure->setValue(0.4);
  const auto turnWheel = [&](int delta) {
    const QPointF place = pixelOf(0.1, 0.1);
    QWheelEvent event(place, place, QPoint(), QPoint(0, delta), Qt::NoButton, Qt::NoModifier,
                      Qt::NoScrollPhase, false);
    QApplication::sendEvent(window_.get(), &event);
  };
  turnWheel(240);
  EXPECT_NEAR(pressure->getValue().toDouble(), 0.5, 1e-6);
  turnWheel(-120);
  EXPECT_NEAR(pressure->getValue().toDouble(), 0.45, 1e-6);
  for (int k = 0; k < 30; ++k) turnWheel(120);
  EXPECT_EQ(pressure->getValue().toDouble(), 1.0);

  pressure->setValue(0.4);
  const auto depthAt = [](double q) { return -0.3 * 0.045 * (q - 0.01) / 0.99; };
  const auto settlesAt = [&](double wanted) {
    return workUntil([&] { return std::abs(height(*accepted_.newest) - wanted) < 1e-4; });
  };
  send(QEvent::MouseButtonPress, 0.1, 0.1, Qt::LeftButton, Qt::LeftButton);
  EXPECT_TRUE(settlesAt(depthAt(0.4)));
  turnWheel(120);  // With the button down it is felt at once.
  send(QEvent::MouseMove, 0.1, 0.1, Qt::NoButton, Qt::LeftButton);
  EXPECT_TRUE(settlesAt(depthAt(0.45)));
  send(QEvent::MouseButtonRelease, 0.1, 0.1, Qt::LeftButton, Qt::NoButton);
  EXPECT_TRUE(workUntil([&] { return height(*accepted_.newest) > 0.004; }));
}

TEST_F(BrushToolPlugin, AnotherToolLiftsTheBrush) {
  send(QEvent::MouseButtonPress, 0.1, 0.1, Qt::LeftButton, Qt::LeftButton);
  ASSERT_TRUE(workUntil([&] { return height(*accepted_.newest) < -0.005; }));
  rviz::Tool* other = manager_->getToolManager()->addTool("rviz/MoveCamera");
  manager_->getToolManager()->setCurrentTool(other);
  ASSERT_TRUE(workUntil([&] { return height(*accepted_.newest) > 0.004; }));
  workFor(0.1);
  const int count = accepted_.count;
  drag(0.1, 0.15, 0.1, Qt::LeftButton, 0.2);
  EXPECT_EQ(accepted_.count, count) << "it writes without being in hand";
}

TEST_F(BrushToolPlugin, FollowsTheBrushOfTheSimulator) {
  ASSERT_TRUE(applyPresets("brush_simulator", "large", "").success);
  const auto points = [&](double tip_length) {
    return workUntil([&] {
      point(0.1, 0.1 + 0.0005 * (accepted_.count % 2), Qt::NoButton);
      workFor(0.02);
      return std::abs(accepted_.newest->pose.position.z - tip_length - 0.005) < 1e-3;
    });
  };
  EXPECT_TRUE(points(0.08)) << accepted_.newest->pose.position.z;
  ASSERT_TRUE(applyPresets("brush_simulator", "medium", "").success);
  EXPECT_TRUE(points(0.045)) << accepted_.newest->pose.position.z;
}

// ---------------------------------------------------------------- panel

class BrushPanelPlugin : public Plugins {
 protected:
  void SetUp() override {
    Plugins::SetUp();
    panel_ = loader_.createInstance("calligraphy_brush/BrushPanel");
    panel_->onInitialize();
    panel_->show();
    ASSERT_TRUE(workUntil([&] { return find<QProgressBar>("ink")->isEnabled(); })) << "no brush_state";
  }
  void TearDown() override { panel_.reset(); }

  template <class Widget>
  Widget* find(const char* name) {
    auto* widget = panel_->findChild<Widget*>(name);
    EXPECT_NE(widget, nullptr) << name;
    return widget;
  }
  /// Presses a button and waits for the answer.
  std::string press(const char* name) {
    auto* button = find<QPushButton>(name);
    EXPECT_TRUE(button->isEnabled()) << name;
    button->click();
    EXPECT_FALSE(button->isEnabled()) << "it could be pressed twice";
    EXPECT_TRUE(workUntil([&] { return button->isEnabled(); })) << name;
    return find<QLabel>("answer")->text().toStdString();
  }
  bool isRed() { return find<QLabel>("answer")->styleSheet().contains("color"); }

  pluginlib::ClassLoader<rviz::Panel> loader_{"rviz", "rviz::Panel"};
  boost::shared_ptr<rviz::Panel> panel_;
};

TEST_F(BrushPanelPlugin, ItsButtonsDoWhatTheySay) {
  EXPECT_EQ(press("wipe_brush"), "the tip has no ink");
  EXPECT_FALSE(isRed());
  EXPECT_TRUE(workUntil([&] { return find<QProgressBar>("ink")->value() == 0; }));
  EXPECT_EQ(press("dip_brush"), "the tip is full of ink");
  EXPECT_TRUE(workUntil([&] { return find<QProgressBar>("ink")->value() == 1000; }));
  EXPECT_EQ(press("clear_paper"), "the sheet is clean");
  EXPECT_EQ(press("reset"), "clean sheet, dipped brush, no poses");
}

TEST_F(BrushPanelPlugin, ShowsWhatAServiceComplainsOf) {
  const std::string answer = press("save_image");
  EXPECT_NE(answer.find("/proc/no/such/folder.png"), std::string::npos) << answer;
  EXPECT_TRUE(isRed());
  EXPECT_EQ(press("dip_brush"), "the tip is full of ink");
  EXPECT_FALSE(isRed());
}

TEST_F(BrushPanelPlugin, SaysWhenThereIsNoSuchSimulator) {
  auto* name = find<QLineEdit>("simulator");
  for (const auto& [text, complaint] :
       {std::make_pair("nobody/here", "nobody offers"), std::make_pair("no name", "")}) {
    name->setText(text);
    Q_EMIT name->editingFinished();
    EXPECT_FALSE(find<QProgressBar>("ink")->isEnabled());
    EXPECT_NE(find<QLabel>("pace")->text().toStdString().find("no brush_state"), std::string::npos);
    const std::string answer = press("dip_brush");
    EXPECT_NE(answer.find(complaint), std::string::npos) << answer;
    EXPECT_FALSE(answer.empty());
    EXPECT_TRUE(isRed());
  }
  name->setText("brush_simulator");
  Q_EMIT name->editingFinished();
  EXPECT_TRUE(workUntil([&] { return find<QProgressBar>("ink")->isEnabled(); }));
}

TEST_F(BrushPanelPlugin, PresetsGiveAnotherBrushAndSheetAndTakeTheOldOneBack) {
  auto* brush = find<QComboBox>("brush");
  auto* paper = find<QComboBox>("paper");
  ASSERT_TRUE(workUntil([&] { return brush->currentText() == "medium"; }));
  EXPECT_EQ(paper->currentText(), "half_hanshi");
  Listener<ParameterValues> parameters(node_, "brush_parameters");
  ASSERT_TRUE(workUntil([&] { return parameters.newest != nullptr; }));
  const auto before = *parameters.newest;
  const auto value = [&](const std::string& name) {
    const auto& names = parameters.newest->names;
    return parameters.newest
        ->values[static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin())];
  };

  brush->setCurrentText("large");
  paper->setCurrentText("washi");
  EXPECT_EQ(press("apply").rfind("brush and sheet as the parameters say now", 0), 0U);
  ASSERT_TRUE(workUntil([&] { return value("brush/rod_count") == "256"; }));
  EXPECT_EQ(std::stod(value("paper/roughness")), 30e-6);
  ASSERT_TRUE(workUntil([&] { return brush->currentText() == "large"; }));

  // What only the preset before had is gone.
  brush->setCurrentText("medium");
  paper->setCurrentText("half_hanshi");
  press("apply");
  ASSERT_TRUE(workUntil([&] { return value("brush/rod_count") == "128"; }));
  EXPECT_EQ(parameters.newest->values, before.values);

  // A value of somebody else that does not go with it: nothing is left half done.
  ros::param::set("brush_simulator/brush/node_count", 1);
  brush->setCurrentText("small");
  const std::string answer = press("apply");
  EXPECT_NE(answer.find("brush/node_count = 1 is outside"), std::string::npos) << answer;
  EXPECT_TRUE(isRed());
  double tip_length = 0.0;
  ros::param::get("brush_simulator/brush/tip_length", tip_length);
  EXPECT_EQ(tip_length, 0.045) << "the parameters were not put back";
  ros::param::del("brush_simulator/brush/node_count");
}

TEST_F(BrushPanelPlugin, RemembersItsSimulator) {
  rviz::Config config;
  find<QLineEdit>("simulator")->setText("desk/brush_simulator");
  panel_->save(config);
  find<QLineEdit>("simulator")->setText("brush_simulator");
  panel_->load(config);
  EXPECT_EQ(find<QLineEdit>("simulator")->text(), "desk/brush_simulator");
}

}  // namespace
}  // namespace calligraphy_brush

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  // An X server of its own, which picks a free number and says it.
  int ends[2];
  if (pipe(ends) != 0) return 1;
  calligraphy_brush::Child server(
      {XVFB, "-displayfd", std::to_string(ends[1]), "-screen", "0", "1024x768x24", "-nolisten", "tcp"});
  close(ends[1]);
  std::string number;
  for (char digit = 0; read(ends[0], &digit, 1) == 1 && digit != '\n';) number += digit;
  if (number.empty()) {
    std::fprintf(stderr, "%s did not start\n", XVFB);
    return 1;
  }
  setenv("DISPLAY", (":" + number).c_str(), 1);
  setenv("LIBGL_ALWAYS_SOFTWARE", "1", 1);
  int result = 1;
  {
    QApplication application(argc, argv);
    ros::init(argc, argv, "rviz_test");
    const ros::NodeHandle node;  // Else each test that drops its last one would end ROS.
    result = RUN_ALL_TESTS();
  }
  return result;
}
