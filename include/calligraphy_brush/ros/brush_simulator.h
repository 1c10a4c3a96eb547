#pragma once

#include <calligraphy_brush/BrushEvent.h>
#include <calligraphy_brush/BrushState.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <image_transport/image_transport.h>
#include <ros/ros.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_broadcaster.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calligraphy_brush/ros/brush_simulator_parameters.h"
#include "calligraphy_brush/sim/simulator.h"

namespace calligraphy_brush {

/// The simulator on ROS: topics, services, parameters, frames. Node and nodelet are shells over it.
///
/// All callbacks must come from one thread, as from ros::spin or a nodelet's ordinary node handle.
/// The result of a stroke depends on the poses accepted and the events between them, which are told on
/// accepted_pose and brush_events, and on nothing else: not on rates, load or watchers.
class BrushSimulator {
 public:
  /// Reads the parameters, connects, and is ready. `name` is the node's or nodelet's own.
  /// Throws ParameterError naming every wrong parameter.
  BrushSimulator(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                 const std::string& name);
  ~BrushSimulator();
  BrushSimulator(const BrushSimulator&) = delete;
  BrushSimulator& operator=(const BrushSimulator&) = delete;

 private:
  /// Why a pose was refused; those of PoseVerdict, and what happens before it comes there.
  enum Refusal {
    kNotFinite,
    kOutOfReach,
    kZeroQuaternion,
    kNotLater,
    kTooFast,
    kUnknownFrame,
    kTooFarAhead,
    kTooMany,
    kRefusalCount
  };

  /// A pose that has been received and not yet simulated.
  struct WaitingPose {
    geometry_msgs::PoseStampedConstPtr message;
    ros::SteadyTime arrival;
    ros::Time arrival_stamp;  // by the clock that stamps are made with
  };

  /// Simulated time and the wall time it took [s].
  struct Pace {
    double simulated = 0.0;
    double wall = 0.0;
    double factorSince(const Pace& before) const;
  };

  void receivePose(const geometry_msgs::PoseStampedConstPtr& message);
  void receiveTransforms(const ros::MessageEvent<const tf2_msgs::TFMessage>& event, bool are_static);
  void takeHandleFrame();
  void receiveCommand(const BrushEventConstPtr& command);
  void scheduleWork();
  void work();
  bool simulateNextPose();
  void simulateWaitingPoses();
  std::optional<HandlePose> toPaper(const geometry_msgs::PoseStamped& message,
                                    std::string& problem) const;
  double secondsAhead(const WaitingPose& waiting) const;
  void simulate(const HandlePose& pose, const WaitingPose& waiting);
  void advance();
  void refuse(Refusal refusal, const HandlePose& pose, const std::string& problem);

  void applyEvent(std::uint8_t kind);
  template <class IsDue>
  void applyCommandsWhile(const IsDue& is_due);
  void watchPoses();
  void compareClocks();

  void offerService(const std::string& name, const std::function<std::string()>& action);
  bool takeNewParameters();
  void reset();
  std::string saveImage() const;

  std_msgs::Header makeHeader() const;
  double backlog() const;
  std::uint64_t refusedCount() const;
  void publishPictures();
  void publishBrush();
  void publishBrushAtRest();
  void publishParameters();
  void publishWrench();
  void publishState();
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);

  ros::NodeHandle node_;
  ros::NodeHandle private_node_;
  std::string name_;
  BrushSimulatorParameters parameters_;
  Simulator simulator_;

  std::deque<WaitingPose> waiting_poses_;
  std::deque<BrushEventConstPtr> waiting_commands_;
  bool work_is_scheduled_ = false;
  std::atomic<bool> is_closing_{false};
  std::int64_t newest_stamp_ns_ = 0;  // of the accepted poses
  ros::SteadyTime newest_arrival_;    // of the accepted poses
  ros::Time newest_arrival_stamp_;
  std::uint64_t accepted_count_ = 0;
  bool is_holding_ = false;
  std::array<std::uint64_t, kRefusalCount> refused_counts_{};
  std::array<ros::SteadyTime, kRefusalCount> warned_at_{};

  // Arrival minus stamp [s]: the least since the last comparison, and what that found.
  std::optional<double> least_difference_;
  double clock_difference_ = 0.0;
  bool warned_of_clocks_ = false;

  ros::Time handle_frame_stamp_;  // of the newest pose taken from tf
  bool warned_of_fixed_frame_ = false;

  // The wrenches of the steps between two poses, to be published evenly.
  std::deque<geometry_msgs::WrenchStamped> waiting_wrenches_;
  std::optional<geometry_msgs::WrenchStamped> newest_wrench_;
  std::int64_t next_wrench_ns_ = 0;

  Pace pace_;
  Pace pace_at_state_;
  Pace pace_at_diagnosis_;
  std::uint64_t refused_at_diagnosis_ = 0;
  std::int64_t unconverged_at_diagnosis_ = 0;

  // What was published last; empty if it must be published again.
  std::optional<std::uint64_t> image_revision_;
  std::optional<std::uint64_t> map_revision_;
  std::optional<std::int64_t> markers_time_ns_;
  std::optional<std::int64_t> frame_time_ns_;
  ros::SteadyTime brush_published_at_;

  tf2_ros::Buffer tf_buffer_;
  tf2_ros::TransformBroadcaster tf_broadcaster_;
  image_transport::ImageTransport image_transport_;
  image_transport::Publisher image_publisher_;
  ros::Publisher map_publisher_;
  ros::Publisher marker_publisher_;
  ros::Publisher wrench_publisher_;
  ros::Publisher state_publisher_;
  ros::Publisher accepted_publisher_;
  ros::Publisher event_publisher_;
  ros::Publisher parameter_publisher_;
  diagnostic_updater::Updater diagnostics_;
  std::vector<ros::ServiceServer> services_;
  std::vector<ros::WallTimer> timers_;
  ros::WallTimer tf_retry_timer_;
  ros::WallTimer wrench_timer_;
  ros::Subscriber tf_subscriber_;
  ros::Subscriber static_tf_subscriber_;
  ros::Subscriber command_subscriber_;
  ros::Subscriber pose_subscriber_;
};

}  // namespace calligraphy_brush
