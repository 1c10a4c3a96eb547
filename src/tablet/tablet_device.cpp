#include "calligraphy_brush/tablet/tablet_device.h"

#include <fcntl.h>
#include <libevdev/libevdev.h>
#include <poll.h>
#include <sys/types.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <set>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

namespace fs = std::filesystem;

std::int64_t stampOf(const input_event& event) {
  return std::int64_t{event.input_event_sec} * 1'000'000'000 +
         std::int64_t{event.input_event_usec} * 1'000;
}

std::int64_t nowRealtime() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

TabletDescription describe(const libevdev* device) {
  TabletDescription d;
  d.name = libevdev_get_name(device);
  d.bus = static_cast<std::uint16_t>(libevdev_get_id_bustype(device));
  d.vendor = static_cast<std::uint16_t>(libevdev_get_id_vendor(device));
  d.product = static_cast<std::uint16_t>(libevdev_get_id_product(device));
  d.version = static_cast<std::uint16_t>(libevdev_get_id_version(device));
  for (unsigned property = 0; property <= INPUT_PROP_MAX; ++property)
    if (libevdev_has_property(device, property) != 0)
      d.properties.insert(static_cast<std::uint16_t>(property));
  for (unsigned type = 0; type <= EV_MAX; ++type) {
    if (libevdev_has_event_type(device, type) == 0) continue;
    const int last = libevdev_event_type_get_max(type);
    for (int code = 0; code <= last; ++code)
      if (libevdev_has_event_code(device, type, static_cast<unsigned>(code)) != 0)
        d.codes[static_cast<std::uint16_t>(type)].insert(static_cast<std::uint16_t>(code));
  }
  for (const std::uint16_t code : d.codes[EV_ABS]) {
    const input_absinfo& info = *libevdev_get_abs_info(device, code);
    d.axes[code] = {info.minimum, info.maximum, info.fuzz, info.flat, info.resolution};
  }
  return d;
}

/// File descriptor of an event device, or −1 and errno.
int openForReading(const std::string& path) {
  return open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
}

std::string lowerCase(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// event2 before event10.
bool isBefore(const fs::path& a, const fs::path& b) {
  const std::string x = a.string(), y = b.string();
  return x.size() != y.size() ? x.size() < y.size() : x < y;
}

}  // namespace

TabletDevice::TabletDevice(const std::string& path, bool grab) : path_(path) {
  const auto fail = [&](int error, const std::string& doing) {
    if (device_ != nullptr) libevdev_free(device_);
    if (file_ >= 0) close(file_);
    throw std::runtime_error("cannot " + doing + " " + path + ": " + std::strerror(error) +
                             (error == EACCES
                                  ? "; add yourself to its group: sudo usermod -aG input $USER,"
                                    " then log in anew"
                                  : ""));
  };
  file_ = openForReading(path);
  if (file_ < 0) fail(errno, "open");
  if (const int error = libevdev_new_from_fd(file_, &device_); error != 0) {
    device_ = nullptr;
    fail(-error, "read the axes of");
  }
  if (const int error = libevdev_set_clock_id(device_, CLOCK_REALTIME); error != 0)
    fail(-error, "choose the clock of");
  if (grab)
    if (const int error = libevdev_grab(device_, LIBEVDEV_GRAB); error != 0) fail(-error, "grab");
  description_ = describe(device_);
  if (!isPenTablet(description_)) {
    const std::string name = description_.name;
    libevdev_free(device_);
    close(file_);
    throw std::runtime_error(path + " (" + name + ") is not a pen tablet");
  }
}

TabletDevice::~TabletDevice() {
  libevdev_free(device_);
  close(file_);
}

/// What is on as it is opened: a pen may be near already, and the kernel sends only what changes.
void TabletDevice::appendState(std::vector<InputEvent>& events) const {
  const std::int64_t now_ns = nowRealtime();
  bool has_tool = false;
  std::vector<InputEvent> state;
  for (const auto& [type, codes] : description_.codes) {
    if (type != EV_KEY && type != EV_ABS) continue;
    for (const std::uint16_t code : codes) {
      const int value = libevdev_get_event_value(device_, type, code);
      if (type == EV_KEY && value == 0) continue;
      has_tool = has_tool || type == EV_KEY;
      state.push_back({now_ns, type, code, value});
    }
  }
  // Without a tool the axes are at rest, and what they say is nothing.
  if (!has_tool) return;
  events.insert(events.end(), state.begin(), state.end());
  events.push_back({now_ns, EV_SYN, SYN_REPORT, 0});
}

bool TabletDevice::read(std::vector<InputEvent>& events, int timeout_ms) {
  if (!told_state_) {
    told_state_ = true;
    appendState(events);
  }
  // libevdev may hold events that it has read already; then there is nothing to wait for.
  const bool may_wait = libevdev_has_event_pending(device_) <= 0 && !is_syncing_;
  pollfd wait{file_, POLLIN, 0};
  if (poll(&wait, 1, may_wait ? timeout_ms : 0) < 0) return errno == EINTR;
  const bool is_hung_up = (wait.revents & (POLLHUP | POLLERR | POLLNVAL)) != 0;
  const std::size_t before = events.size();
  for (;;) {
    input_event event{};
    const int status = libevdev_next_event(
        device_, is_syncing_ ? LIBEVDEV_READ_FLAG_SYNC : LIBEVDEV_READ_FLAG_NORMAL, &event);
    if (status == LIBEVDEV_READ_STATUS_SYNC && !is_syncing_) {
      // The event is SYN_DROPPED. What was read since the last report is lost in part: the report that
      // tells the state stands for it.
      is_syncing_ = true;
      ++drop_count_;
      continue;
    }
    if (status == -EAGAIN) {
      if (!is_syncing_) return !is_hung_up || events.size() > before;
      is_syncing_ = false;
      continue;
    }
    if (status == -EINTR) continue;
    if (status < 0) return false;  // ENODEV: unplugged
    events.push_back({stampOf(event), event.type, event.code, event.value});
  }
}

TabletSearch findTablets(const std::string& folder) {
  std::vector<fs::path> paths;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().filename().string().rfind("event", 0) == 0) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end(), isBefore);

  TabletSearch search;
  for (const fs::path& path : paths) {
    const int file = openForReading(path.string());
    if (file < 0) {
      if (errno == EACCES || errno == EPERM) search.unreadable.push_back(path.string());
      continue;
    }
    libevdev* device = nullptr;
    if (libevdev_new_from_fd(file, &device) == 0) {
      FoundTablet found{path.string(), describe(device)};
      if (isPenTablet(found.description)) search.tablets.push_back(std::move(found));
      libevdev_free(device);
    }
    close(file);
  }
  return search;
}

std::optional<std::string> chooseTablet(const TabletSearch& search, const std::string& wanted) {
  if (wanted.empty())
    return search.tablets.empty() ? std::nullopt : std::optional(search.tablets.front().path);
  if (wanted.front() == '/') {
    std::error_code error;
    return fs::exists(wanted, error) ? std::optional(wanted) : std::nullopt;
  }
  for (const FoundTablet& tablet : search.tablets)
    if (tablet.description.name == wanted) return tablet.path;
  for (const FoundTablet& tablet : search.tablets)
    if (lowerCase(tablet.description.name).find(lowerCase(wanted)) != std::string::npos)
      return tablet.path;
  return std::nullopt;
}

}  // namespace calligraphy_brush
