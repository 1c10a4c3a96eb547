#include "calligraphy_brush/tablet/tablet_device.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <linux/input.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cstdarg>
#include <cstring>
#include <ctime>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "calligraphy_brush/tablet/tablet_decoder.h"
#include "temporary_folder.h"

// A tablet without a tablet: a FIFO for the events, and this program's own ioctl, which libevdev then
// calls instead of the C library's, for what the kernel would say about the device.

namespace {

/// What the kernel knows of the one device.
struct FakeKernel {
  std::map<unsigned, std::set<unsigned>> codes;
  std::map<unsigned, input_absinfo> axes;
  std::set<unsigned> keys_down;
  int clock = -1;
  int grabs = 0;
};
FakeKernel kernel;

int copyBits(const std::set<unsigned>& bits, void* place, unsigned size) {
  auto* bytes = static_cast<unsigned char*>(place);
  std::memset(bytes, 0, size);
  for (const unsigned bit : bits)
    if (bit / 8 < size) bytes[bit / 8] = static_cast<unsigned char>(bytes[bit / 8] | 1U << (bit % 8));
  return static_cast<int>(size);
}

int answer(unsigned long request, void* place) {
  const unsigned number = _IOC_NR(request), size = _IOC_SIZE(request);
  if (request == EVIOCGVERSION) {
    *static_cast<int*>(place) = EV_VERSION;
  } else if (request == EVIOCGID) {
    *static_cast<input_id*>(place) = {3, 0x56a, 0x1234, 1};
  } else if (number == _IOC_NR(EVIOCGNAME(0))) {
    std::strncpy(static_cast<char*>(place), "Fake Tablet Pen", size);
    return 16;
  } else if (number == _IOC_NR(EVIOCGKEY(0))) {
    return copyBits(kernel.keys_down, place, size);
  } else if (number >= _IOC_NR(EVIOCGBIT(0, 0)) && number <= _IOC_NR(EVIOCGBIT(EV_MAX, 0))) {
    const auto type = static_cast<unsigned>(number - _IOC_NR(EVIOCGBIT(0, 0)));
    std::set<unsigned> types;
    for (const auto& [known, codes] : kernel.codes) types.insert(known);
    return copyBits(type == 0 ? types : kernel.codes[type], place, size);
  } else if (number >= _IOC_NR(EVIOCGABS(0)) && number <= _IOC_NR(EVIOCGABS(ABS_MAX))) {
    *static_cast<input_absinfo*>(place) =
        kernel.axes[static_cast<unsigned>(number - _IOC_NR(EVIOCGABS(0)))];
  } else if (request == EVIOCSCLOCKID) {
    kernel.clock = *static_cast<int*>(place);
  } else if (request == EVIOCGRAB) {
    ++kernel.grabs;
  } else if (number == _IOC_NR(EVIOCGPROP(0)) || number == _IOC_NR(EVIOCGLED(0)) ||
             number == _IOC_NR(EVIOCGSW(0))) {
    return copyBits({}, place, size);
  } else {
    errno = ENOENT;  // no physical place, no unique name
    return -1;
  }
  return 0;
}

}  // namespace

extern "C" int ioctl(int file, unsigned long request, ...) noexcept {
  va_list arguments;
  va_start(arguments, request);
  void* place = va_arg(arguments, void*);
  va_end(arguments);
  if (_IOC_TYPE(request) == 'E') return answer(request, place);
  return static_cast<int>(syscall(SYS_ioctl, file, request, place));
}

namespace calligraphy_brush {
namespace {

class FakeTablet : public testing::Test {
 protected:
  void SetUp() override {
    kernel = {};
    kernel.codes[EV_SYN] = {SYN_REPORT, SYN_DROPPED};
    kernel.codes[EV_KEY] = {BTN_TOOL_PEN, BTN_TOUCH, BTN_STYLUS};
    kernel.codes[EV_ABS] = {ABS_X, ABS_Y, ABS_PRESSURE};
    kernel.axes[ABS_X] = {0, 0, 20000, 4, 0, 100};
    kernel.axes[ABS_Y] = {0, 0, 10000, 4, 0, 100};
    kernel.axes[ABS_PRESSURE] = {0, 0, 1000, 0, 0, 0};
    path_ = folder_.path("event7");
    ASSERT_EQ(mkfifo(path_.c_str(), 0600), 0);
    // Both ends, so that it stays while nobody else has it open.
    writer_ = open(path_.c_str(), O_RDWR | O_NONBLOCK);
    ASSERT_GE(writer_, 0);
  }
  void TearDown() override { unplug(); }
  void unplug() {
    if (writer_ >= 0) close(writer_);
    writer_ = -1;
  }

  void send(std::uint16_t type, std::uint16_t code, int value,
            std::int64_t stamp_us = 1'700'000'000'000'005) {
    input_event event{};
    event.input_event_sec = static_cast<decltype(event.input_event_sec)>(stamp_us / 1'000'000);
    event.input_event_usec = static_cast<decltype(event.input_event_usec)>(stamp_us % 1'000'000);
    event.type = type;
    event.code = code;
    event.value = value;
    ASSERT_EQ(write(writer_, &event, sizeof event), static_cast<ssize_t>(sizeof event));
  }
  /// Samples from what is there now.
  std::vector<PenSample> read(TabletDevice& device, TabletDecoder& decoder) {
    std::vector<InputEvent> events;
    EXPECT_TRUE(device.read(events, 0));
    std::vector<PenSample> samples;
    for (const InputEvent& event : events)
      if (const auto sample = decoder.take(event)) samples.push_back(*sample);
    return samples;
  }

  TemporaryFolder folder_;
  std::string path_;
  int writer_ = -1;
};

TEST_F(FakeTablet, IsFoundDescribedAndReadAtTheKernelsTime) {
  const TabletSearch search = findTablets(folder_.path(""));
  ASSERT_EQ(search.tablets.size(), 1U);
  EXPECT_EQ(search.tablets[0].path, path_);
  EXPECT_EQ(chooseTablet(search, "fake"), path_);

  TabletDevice device(path_, true);
  EXPECT_EQ(kernel.clock, CLOCK_REALTIME);
  EXPECT_EQ(kernel.grabs, 1);
  EXPECT_EQ(device.description().name, "Fake Tablet Pen");
  EXPECT_EQ(device.description().axes.at(ABS_X).resolution, 100);
  TabletDecoder decoder(device.description(), {});
  EXPECT_TRUE(read(device, decoder).empty()) << "no pen is near";
  send(EV_KEY, BTN_TOOL_PEN, 1);
  send(EV_ABS, ABS_X, 5000);
  send(EV_ABS, ABS_Y, 2000);
  send(EV_SYN, SYN_REPORT, 0);
  const auto samples = read(device, decoder);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_EQ(samples[0].stamp_ns, 1'700'000'000'000'005'000);
  EXPECT_NEAR(samples[0].x, 0.05, 1e-12);
  EXPECT_NEAR(samples[0].y, 0.08, 1e-12);
}

TEST_F(FakeTablet, PenThatIsNearAlreadyIsToldFirst) {
  kernel.keys_down = {BTN_TOOL_PEN, BTN_TOUCH};
  kernel.axes[ABS_X].value = 7000;
  kernel.axes[ABS_PRESSURE].value = 300;
  TabletDevice device(path_, false);
  TabletDecoder decoder(device.description(), {});
  const auto samples = read(device, decoder);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_NEAR(samples[0].x, 0.07, 1e-12);
  EXPECT_TRUE(samples[0].touching);
  EXPECT_TRUE(read(device, decoder).empty());
}

TEST_F(FakeTablet, StateIsAskedForWhenEventsWereDropped) {
  TabletDevice device(path_, false);
  TabletDecoder decoder(device.description(), {});
  send(EV_KEY, BTN_TOOL_PEN, 1);
  send(EV_ABS, ABS_X, 5000);
  send(EV_ABS, ABS_Y, 2000);
  send(EV_SYN, SYN_REPORT, 0);
  read(device, decoder);
  // Meanwhile it moved and touched; the kernel's buffer did not hold it all.
  kernel.keys_down = {BTN_TOOL_PEN, BTN_TOUCH};
  kernel.axes[ABS_X].value = 9000;
  kernel.axes[ABS_Y].value = 2000;
  kernel.axes[ABS_PRESSURE].value = 400;
  send(EV_SYN, SYN_DROPPED, 0, 1'700'000'000'010'000);
  auto samples = read(device, decoder);
  for (const auto& more : read(device, decoder)) samples.push_back(more);
  ASSERT_FALSE(samples.empty());
  EXPECT_EQ(device.dropCount(), 1);
  EXPECT_NEAR(samples.back().x, 0.09, 1e-12);
  EXPECT_TRUE(samples.back().touching);
  EXPECT_NEAR(samples.back().pressure, 0.4, 1e-12);
  // And it goes on.
  send(EV_ABS, ABS_X, 9100, 1'700'000'000'020'000);
  send(EV_SYN, SYN_REPORT, 0, 1'700'000'000'020'000);
  samples = read(device, decoder);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_NEAR(samples[0].x, 0.091, 1e-12);
}

TEST_F(FakeTablet, UnpluggedIsNoticedAndItCanComeBack) {
  {
    TabletDevice device(path_, false);
    std::vector<InputEvent> events;
    EXPECT_TRUE(device.read(events, 0));
    unplug();
    EXPECT_FALSE(device.read(events, 100));
  }
  writer_ = open(path_.c_str(), O_RDWR | O_NONBLOCK);
  TabletDevice again(path_, false);
  std::vector<InputEvent> events;
  EXPECT_TRUE(again.read(events, 0));
}

TEST_F(FakeTablet, WhatIsNoPenTabletIsRefusedByName) {
  kernel.codes[EV_KEY] = {BTN_LEFT};
  EXPECT_TRUE(findTablets(folder_.path("")).tablets.empty());
  try {
    const TabletDevice device(path_, false);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(std::string(error.what()), path_ + " (Fake Tablet Pen) is not a pen tablet");
  }
}

}  // namespace
}  // namespace calligraphy_brush
