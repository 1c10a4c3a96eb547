#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_msgs/TFMessage.h>

#include <opencv2/imgproc.hpp>

#include "../vision/render_board.h"
#include "ros_fixture.h"

// marker_tracker_node sees rendered pictures of the board on the shaft, and moves the brush of
// brush_simulator_node by way of tf.

namespace calligraphy_brush {
namespace {

constexpr int kWidth = 1280, kHeight = 720;
constexpr double kDegree = 3.14159265358979 / 180.0;

CameraModel makeCamera() {
  CameraModel camera;
  camera.fx = 950.0;
  camera.fy = 948.0;
  camera.cx = 645.3;
  camera.cy = 352.8;
  camera.distortion = {-0.28, 0.09, 0.0007, -0.0011, -0.012};
  return camera;
}

class MarkerTrackerNode : public testing::Test {
 protected:
  void SetUp() override {
    images_ = node_.advertise<sensor_msgs::Image>("camera/image_raw", 10);
    infos_ = node_.advertise<sensor_msgs::CameraInfo>("camera/camera_info", 10);
    frames_ = node_.advertise<tf2_msgs::TFMessage>("/tf_static", 10, true);
    ASSERT_TRUE(spinUntil([&] {
      return images_.getNumSubscribers() > 0 && infos_.getNumSubscribers() > 0 && poses_.isConnected() &&
             accepted_.isConnected() && frames_.getNumSubscribers() > 0;
    })) << "no marker_tracker";
  }

  /// Publishes what the camera sees; the stamp.
  ros::Time show(const cv::Mat& picture, const std::string& encoding, int info_width = kWidth) {
    // At its own time, and later than the picture before.
    stamp_ = std::max(ros::Time::now(), stamp_ + ros::Duration(0.01));
    sensor_msgs::Image image;
    image.header.stamp = stamp_;
    image.header.frame_id = "camera";
    image.width = static_cast<std::uint32_t>(picture.cols);
    image.height = static_cast<std::uint32_t>(picture.rows);
    image.encoding = encoding;
    image.step = static_cast<std::uint32_t>(picture.step);
    image.data.assign(picture.datastart, picture.dataend);
    sensor_msgs::CameraInfo info;
    info.header = image.header;
    info.width = static_cast<std::uint32_t>(info_width);
    info.height = kHeight;
    info.distortion_model = "plumb_bob";
    info.D = camera_.distortion;
    info.K = {camera_.fx, 0, camera_.cx, 0, camera_.fy, camera_.cy, 0, 0, 1};
    infos_.publish(info);
    images_.publish(image);
    return stamp_;
  }

  cv::Mat render(const Eigen::Isometry3d& X_CH) const {
    CameraFaults faults;
    faults.blur = 0.7;
    faults.noise = 3.0;
    return renderBoard(board_, X_CH, camera_, kWidth, kHeight, faults, 5);
  }

  bool arrives(const ros::Time& stamp) {
    return spinUntil([&] { return poses_.newest && poses_.newest->header.stamp == stamp; });
  }
  void expectPose(const geometry_msgs::PoseStamped& message, const Eigen::Isometry3d& truth) const {
    const HandlePose pose = toHandlePose(message);
    EXPECT_LT((pose.position - truth.translation()).norm(), 1e-3);
    EXPECT_LT(pose.orientation.angularDistance(Eigen::Quaterniond(truth.linear())), kDegree);
  }

  ros::NodeHandle node_;
  ros::Publisher images_, infos_, frames_;
  Listener<geometry_msgs::PoseStamped> poses_{node_, "handle_pose"};
  Listener<geometry_msgs::PoseStamped> accepted_{node_, "accepted_pose"};
  const BoardParameters board_;
  const CameraModel camera_ = makeCamera();
  ros::Time stamp_ = ros::Time(1.0);
};

TEST_F(MarkerTrackerNode, FindsTheHandleAndMovesTheBrushThroughTf) {
  // The camera stands before the sheet; the handle is upright over it.
  Eigen::Isometry3d X_PH = Eigen::Isometry3d::Identity();
  X_PH.translation() = Eigen::Vector3d(0.1, 0.08, 0.06);
  X_PH.linear() = Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitX()).toRotationMatrix();
  const Eigen::Isometry3d X_CH = lookAtBoard(board_, 0.5, -1.3, 0.4, 0.1);
  HandlePose camera;
  const Eigen::Isometry3d X_PC = X_PH * X_CH.inverse();
  camera.stamp_ns = toNanoseconds(ros::Time::now());
  camera.position = X_PC.translation();
  camera.orientation = Eigen::Quaterniond(X_PC.linear());
  tf2_msgs::TFMessage frames;
  frames.transforms = {toTransformStamped(camera, "paper", "camera")};
  frames_.publish(frames);

  const ros::Time stamp = show(render(X_CH), sensor_msgs::image_encodings::MONO8);
  ASSERT_TRUE(arrives(stamp));
  EXPECT_EQ(poses_.newest->header.frame_id, "camera");
  expectPose(*poses_.newest, X_CH);
  ASSERT_TRUE(spinUntil([&] { return accepted_.newest && accepted_.newest->header.stamp == stamp; }));
  EXPECT_EQ(accepted_.newest->header.frame_id, "paper");
  expectPose(*accepted_.newest, X_PH);
}

TEST_F(MarkerTrackerNode, ReadsColours) {
  const Eigen::Isometry3d X_CH = lookAtBoard(board_, 0.5, 0.8, 0.5, -0.2);
  const cv::Mat grey = render(X_CH);
  for (const auto& [code, encoding] :
       {std::make_pair(cv::COLOR_GRAY2BGR, "bgr8"), std::make_pair(cv::COLOR_GRAY2RGBA, "rgba8")}) {
    cv::Mat picture;
    cv::cvtColor(grey, picture, code);
    ASSERT_TRUE(arrives(show(picture, encoding))) << encoding;
    expectPose(*poses_.newest, X_CH);
  }
}

TEST_F(MarkerTrackerNode, RefusesWhatItCannotReadAndGoesOn) {
  const Eigen::Isometry3d X_CH = lookAtBoard(board_, 0.5, 2.5, 0.5, 0.0);
  const cv::Mat picture = render(X_CH);
  const cv::Mat empty(kHeight, kWidth, CV_8UC1, cv::Scalar(110));
  show(picture, "bayer_rggb8");
  show(picture, "rgb8");  // a third of the bytes that it needs
  show(picture, sensor_msgs::image_encodings::MONO8, 640);
  show(empty, sensor_msgs::image_encodings::MONO8);
  const int before = poses_.count;
  const ros::Time stamp = show(picture, sensor_msgs::image_encodings::MONO8);
  ASSERT_TRUE(arrives(stamp));
  EXPECT_EQ(poses_.count, before + 1) << "a pose from a picture that shows none";
  expectPose(*poses_.newest, X_CH);
}

}  // namespace
}  // namespace calligraphy_brush

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "marker_tracker_test");
  return RUN_ALL_TESTS();
}
