#pragma once

#include <calligraphy_brush/BrushState.h>
#include <calligraphy_brush/ParameterValues.h>
#include <ros/ros.h>
#include <rviz/panel.h>

#include <QString>
#include <functional>
#include <string>
#include <vector>

#include "calligraphy_brush/ros/simulator_client.h"

class QComboBox;
class QLabel;
class QLineEdit;
class QProgressBar;
class QPushButton;
class QTimer;

namespace calligraphy_brush {

/// "Calligraphy brush": the services of a brush_simulator as buttons, its ink, pace and presets.
///
/// Services are called from another thread; what they answer, and what went wrong, is shown.
class BrushPanel : public rviz::Panel {
  Q_OBJECT
 public:
  explicit BrushPanel(QWidget* parent = nullptr);

  void onInitialize() override;
  void load(const rviz::Config& config) override;
  void save(rviz::Config config) const override;

 Q_SIGNALS:
  void answered(bool success, QString text);

 private Q_SLOTS:
  void connectTopics();
  void showAnswer(bool success, const QString& text);
  void lookForSilence();

 private:
  void addButton(class QLayout* layout, const char* text, const char* service, const char* tip);
  void ask(const std::function<ServiceOutcome(const std::string& simulator)>& question);
  void applyChosen();
  void receiveState(const BrushStateConstPtr& state);
  void receiveParameters(const ParameterValuesConstPtr& message);

  QLineEdit* simulator_;
  QProgressBar* ink_;
  QLabel* ink_text_;
  QLabel* pace_;
  QComboBox* brush_;
  QComboBox* paper_;
  QLabel* answer_;
  std::vector<QPushButton*> buttons_;
  QTimer* timer_;

  ros::NodeHandle node_;
  ros::Subscriber state_subscriber_;
  ros::Subscriber parameter_subscriber_;
  ros::WallTime heard_;  // of the simulator, the last time
  TaskThread tasks_;     // last: it uses the others
};

}  // namespace calligraphy_brush
