#include "brush_panel.h"

#include <QComboBox>
#include <QFormLayout>
#include <QGridLayout>
#include <QHBoxLayout>
#include <QLabel>
#include <QLineEdit>
#include <QProgressBar>
#include <QPushButton>
#include <QTimer>
#include <algorithm>
#include <cmath>
#include <exception>
#include <pluginlib/class_list_macros.hpp>

#include "calligraphy_brush/files/yaml_parameters.h"
#include "calligraphy_brush/ros/conversions.h"

namespace calligraphy_brush {
namespace {

constexpr double kSilence = 1.5;  // [s]: so long after the last brush_state there is no simulator
const char* const kNoPreset = "(its own)";

QComboBox* makePresetBox(const char* kind) {
  auto* box = new QComboBox;
  box->addItem(kNoPreset, QString());
  for (const auto& [name, file] : findPresets(kind))
    box->addItem(QString::fromStdString(name), QString::fromStdString(name));
  return box;
}

void choose(QComboBox* box, const std::string& preset) {
  box->setCurrentIndex(std::max(0, box->findData(QString::fromStdString(preset))));
}

}  // namespace

BrushPanel::BrushPanel(QWidget* parent) : rviz::Panel(parent) {
  auto* buttons = new QHBoxLayout;
  buttons->setSpacing(2);
  addButton(buttons, "Dip", "dip_brush", "Fill the tip with ink");
  addButton(buttons, "Wipe", "wipe_brush", "Take the ink out of the tip");
  addButton(buttons, "Clear", "clear_paper", "Take the ink from the sheet");
  addButton(buttons, "Reset", "reset", "Clean sheet, dipped brush, no poses");
  addButton(buttons, "Save", "save_image", "Write the picture to ~ros/image_path of the simulator");

  ink_ = new QProgressBar;
  ink_->setObjectName("ink");
  ink_->setRange(0, 1000);
  ink_->setToolTip("Ink in the tip over what it can hold");
  ink_->setTextVisible(false);
  ink_->setMaximumHeight(14);
  ink_->setStyleSheet(
      "QProgressBar { border: 1px solid #888; background: white; }"
      "QProgressBar::chunk { background: #1c1a20; }");
  ink_text_ = new QLabel;
  auto* ink = new QHBoxLayout;
  ink->addWidget(ink_, 1);
  ink->addWidget(ink_text_);
  pace_ = new QLabel;
  pace_->setObjectName("pace");
  pace_->setToolTip("Simulated time over the time that it took; rods on the sheet");

  brush_ = makePresetBox("brushes");
  brush_->setObjectName("brush");
  paper_ = makePresetBox("papers");
  paper_->setObjectName("paper");
  auto* apply = new QPushButton("Apply");
  apply->setObjectName("apply");
  apply->setToolTip("Another brush and sheet: sets the parameters of the simulator and resets it");
  connect(apply, &QPushButton::clicked, this, [this] { applyChosen(); });
  buttons_.push_back(apply);
  auto* presets = new QHBoxLayout;
  presets->setSpacing(2);
  presets->addWidget(brush_, 1);
  presets->addWidget(paper_, 1);
  presets->addWidget(apply);

  simulator_ = new QLineEdit("brush_simulator");
  simulator_->setObjectName("simulator");
  simulator_->setToolTip("Name of the node; its topics are beside it");
  connect(simulator_, &QLineEdit::editingFinished, this, [this] {
    connectTopics();
    Q_EMIT configChanged();
  });
  answer_ = new QLabel;
  answer_->setObjectName("answer");
  answer_->setWordWrap(true);
  answer_->setTextInteractionFlags(Qt::TextSelectableByMouse);

  auto* form = new QFormLayout(this);
  form->setContentsMargins(4, 4, 4, 4);
  form->setSpacing(4);
  form->addRow(buttons);
  form->addRow("Ink", ink);
  form->addRow("Pace", pace_);
  form->addRow("Presets", presets);
  form->addRow("Node", simulator_);
  form->addRow(answer_);

  connect(this, &BrushPanel::answered, this, &BrushPanel::showAnswer, Qt::QueuedConnection);
  timer_ = new QTimer(this);
  connect(timer_, &QTimer::timeout, this, &BrushPanel::lookForSilence);
}

void BrushPanel::addButton(QLayout* layout, const char* text, const char* service, const char* tip) {
  auto* button = new QPushButton(text);
  button->setObjectName(service);
  button->setToolTip(tip);
  button->setMinimumWidth(20);
  const std::string name = service;
  connect(button, &QPushButton::clicked, this, [this, name] {
    ask([name](const std::string& simulator) { return callTrigger(simulator + "/" + name); });
  });
  layout->addWidget(button);
  buttons_.push_back(button);
}

void BrushPanel::onInitialize() {
  connectTopics();
  timer_->start(250);
}

void BrushPanel::load(const rviz::Config& config) {
  rviz::Panel::load(config);
  QString simulator;
  if (config.mapGetString("Simulator", &simulator)) simulator_->setText(simulator);
  connectTopics();
}

void BrushPanel::save(rviz::Config config) const {
  rviz::Panel::save(config);
  config.mapSetValue("Simulator", simulator_->text());
}

void BrushPanel::connectTopics() {
  const std::string simulator = simulator_->text().toStdString();
  const auto slash = simulator.rfind('/');
  const std::string ns = slash == std::string::npos ? "" : simulator.substr(0, slash + 1);
  heard_ = ros::WallTime();
  lookForSilence();
  try {
    if (simulator.empty()) throw ros::InvalidNameException("the node needs a name");
    state_subscriber_ = node_.subscribe(ns + "brush_state", 10, &BrushPanel::receiveState, this);
    parameter_subscriber_ =
        node_.subscribe(ns + "brush_parameters", 1, &BrushPanel::receiveParameters, this);
    answer_->clear();
  } catch (const ros::InvalidNameException& error) {
    showAnswer(false, error.what());
  }
}

// ---------------------------------------------------------------- asked

/// Asks from another thread; buttons rest until the answer is there.
void BrushPanel::ask(const std::function<ServiceOutcome(const std::string&)>& question) {
  for (QPushButton* button : buttons_) button->setEnabled(false);
  answer_->setStyleSheet("");
  answer_->setText("...");
  tasks_.post([this, question, simulator = simulator_->text().toStdString()] {
    ServiceOutcome outcome;
    try {
      outcome = question(simulator);
    } catch (const std::exception& error) {  // such as a name that is none
      outcome.message = error.what();
    }
    Q_EMIT answered(outcome.success, QString::fromStdString(outcome.message));
  });
}

void BrushPanel::applyChosen() {
  const std::string brush = brush_->currentData().toString().toStdString();
  const std::string paper = paper_->currentData().toString().toStdString();
  ask([brush, paper](const std::string& simulator) { return applyPresets(simulator, brush, paper); });
}

void BrushPanel::showAnswer(bool success, const QString& text) {
  for (QPushButton* button : buttons_) button->setEnabled(true);
  answer_->setStyleSheet(success ? "" : "color: #b00020; font-weight: bold");
  answer_->setText(text);
}

// ---------------------------------------------------------------- told

void BrushPanel::receiveState(const BrushStateConstPtr& state) {
  heard_ = ros::WallTime::now();
  ink_->setEnabled(true);
  ink_->setValue(static_cast<int>(std::lround(1000.0 * std::clamp(state->ink_left, 0.0, 1.0))));
  ink_text_->setText(QString("%1 %").arg(100.0 * state->ink_left, 0, 'f', 1));
  QString text = state->real_time_factor > 0.0
                     ? QString("%1 x real time").arg(state->real_time_factor, 0, 'f', 1)
                     : QString("at rest");
  text += QString(", %1 rods on the sheet").arg(state->touching_rods);
  if (state->holding) text += ", holds";
  if (state->poses_refused > 0) text += QString(", %1 poses refused").arg(state->poses_refused);
  if (state->backlog > 0.2) text += QString(", %1 s behind").arg(state->backlog, 0, 'f', 1);
  pace_->setText(text);
}

void BrushPanel::lookForSilence() {
  if (!heard_.isZero() && (ros::WallTime::now() - heard_).toSec() < kSilence) return;
  ink_->setEnabled(false);
  ink_->setValue(0);
  ink_text_->clear();
  pace_->setText("no brush_state: is the simulator running?");
}

void BrushPanel::receiveParameters(const ParameterValuesConstPtr& message) {
  try {
    const SimulatorParameters parameters = toSimulatorParameters(*message);
    choose(brush_, matchPreset("brushes", parameters));
    choose(paper_, matchPreset("papers", parameters));
  } catch (const std::exception& error) {
    showAnswer(false, error.what());
  }
}

}  // namespace calligraphy_brush

PLUGINLIB_EXPORT_CLASS(calligraphy_brush::BrushPanel, rviz::Panel)
