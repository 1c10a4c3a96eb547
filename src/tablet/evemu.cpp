#include "calligraphy_brush/tablet/evemu.h"

#include <linux/input-event-codes.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;
constexpr std::int64_t kNanosecondsPerMicrosecond = 1'000;
constexpr std::int64_t kMaxSeconds = 4'000'000'000;  // what ros::Time can hold, nearly

/// A whole number in a range, all of the word; base 10 even with leading zeros.
std::optional<std::int64_t> parseNumber(const std::string& word, int base, std::int64_t low,
                                        std::int64_t high) {
  if (word.empty()) return std::nullopt;
  char* end = nullptr;
  errno = 0;
  const long long value = std::strtoll(word.c_str(), &end, base);
  if (*end != '\0' || errno != 0 || value < low || value > high) return std::nullopt;
  return value;
}

/// "seconds.microseconds" with six digits after the point.
std::optional<std::int64_t> parseStamp(const std::string& word) {
  const std::size_t point = word.find('.');
  if (point == std::string::npos || word.size() != point + 7) return std::nullopt;
  const auto seconds = parseNumber(word.substr(0, point), 10, 0, kMaxSeconds);
  const auto microseconds = parseNumber(word.substr(point + 1), 10, 0, 999'999);
  if (!seconds || !microseconds) return std::nullopt;
  return *seconds * kNanosecondsPerSecond + *microseconds * kNanosecondsPerMicrosecond;
}

class Reader {
 public:
  explicit Reader(std::string path) : path_(std::move(path)) {}

  TabletRecording read() {
    std::ifstream file(path_);
    if (!file) fail("cannot be read: " + std::string(std::strerror(errno)));
    std::string line;
    while (std::getline(file, line)) {
      ++line_number_;
      readLine(line);
    }
    if (file.bad()) fail("cannot be read: " + std::string(std::strerror(errno)));
    if (!recording_.has_description && recording_.events.empty())
      fail("neither a device (line N) nor an event (line E): not an evemu recording");
    return std::move(recording_);
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw std::runtime_error(path_ + (line_number_ > 0 ? ":" + std::to_string(line_number_) : "") +
                             ": " + what);
  }

  int number(const std::string& word, int base, std::int64_t low, std::int64_t high) const {
    const auto value = parseNumber(word, base, low, high);
    if (!value)
      fail("\"" + word + "\" is not a number in [" + std::to_string(low) + ", " + std::to_string(high) +
           "]");
    return static_cast<int>(*value);
  }
  std::uint16_t word16(const std::string& word) const {
    return static_cast<std::uint16_t>(number(word, 16, 0, 0xffff));
  }

  void readLine(const std::string& line) {
    if (line.empty() || line[0] == '#' || line == "\r") return;
    if (line.size() < 2 || line[1] != ':')
      fail("not a line of an evemu recording: " + line.substr(0, 60));
    TabletDescription& d = recording_.description;
    if (line[0] == 'N') {
      const std::size_t begin = line.find_first_not_of(' ', 2);
      d.name = begin == std::string::npos ? "" : line.substr(begin);
      while (!d.name.empty() && (d.name.back() == '\r' || d.name.back() == ' ')) d.name.pop_back();
      recording_.has_description = true;
      return;
    }
    std::istringstream text(line.substr(2, line.find('#') - 2));
    std::vector<std::string> words;
    for (std::string word; text >> word;) words.push_back(word);
    const auto needs = [&](std::size_t least, const char* what) {
      if (words.size() < least) fail(std::string("needs ") + what);
    };
    switch (line[0]) {
      case 'I':
        needs(4, "bus, vendor, product and version");
        d.bus = word16(words[0]);
        d.vendor = word16(words[1]);
        d.product = word16(words[2]);
        d.version = word16(words[3]);
        return;
      case 'P': readBits(words, 0, property_byte_, d.properties); return;
      case 'B': {
        needs(1, "an event type");
        const std::uint16_t type = word16(words[0]);
        readBits(words, 1, code_byte_[type], d.codes[type]);
        if (d.codes[type].empty()) d.codes.erase(type);
        return;
      }
      case 'A': {
        needs(5, "axis, minimum, maximum, fuzz and flat");
        constexpr std::int64_t low = std::numeric_limits<std::int32_t>::min();
        constexpr std::int64_t high = std::numeric_limits<std::int32_t>::max();
        TabletAxis axis;
        axis.minimum = number(words[1], 10, low, high);
        axis.maximum = number(words[2], 10, low, high);
        axis.fuzz = number(words[3], 10, low, high);
        axis.flat = number(words[4], 10, low, high);
        axis.resolution = words.size() > 5 ? number(words[5], 10, 0, high) : 0;
        d.axes[word16(words[0])] = axis;
        return;
      }
      case 'E': {
        needs(4, "time, type, code and value");
        const auto stamp = parseStamp(words[0]);
        if (!stamp) fail("\"" + words[0] + "\" is not a time as seconds.microseconds");
        InputEvent event;
        event.stamp_ns = *stamp;
        event.type = word16(words[1]);
        event.code = word16(words[2]);
        event.value = number(words[3], 10, std::numeric_limits<std::int32_t>::min(),
                             std::numeric_limits<std::int32_t>::max());
        recording_.events.push_back(event);
        return;
      }
      case 'L':
      case 'S': return;  // lamps and switches: a pen has none
      default: fail("unknown kind of line: " + line.substr(0, 60));
    }
  }

  /// Adds the bits of the bytes from words[first] on; `byte` counts those of earlier lines.
  void readBits(const std::vector<std::string>& words, std::size_t first, int& byte,
                std::set<std::uint16_t>& bits) const {
    for (std::size_t k = first; k < words.size(); ++k, ++byte) {
      const int value = number(words[k], 16, 0, 0xff);
      for (int bit = 0; bit < 8; ++bit)
        if ((value >> bit & 1) != 0) bits.insert(static_cast<std::uint16_t>(8 * byte + bit));
    }
  }

  std::string path_;
  int line_number_ = 0;
  int property_byte_ = 0;
  std::map<std::uint16_t, int> code_byte_;
  TabletRecording recording_;
};

void writeBits(std::ostream& file, const std::string& head, const std::set<std::uint16_t>& bits) {
  constexpr int bytes_a_line = 8;
  const int bytes = bits.empty() ? 1 : *bits.rbegin() / 8 + 1;
  char text[8];
  for (int byte = 0; byte < (bytes + bytes_a_line - 1) / bytes_a_line * bytes_a_line; ++byte) {
    unsigned value = 0;
    for (int bit = 0; bit < 8; ++bit)
      if (bits.count(static_cast<std::uint16_t>(8 * byte + bit)) != 0) value |= 1U << bit;
    if (byte % bytes_a_line == 0) file << (byte > 0 ? "\n" : "") << head;
    std::snprintf(text, sizeof text, " %02x", value);
    file << text;
  }
  file << "\n";
}

}  // namespace

TabletRecording readEvemu(const std::string& path) {
  return Reader(path).read();
}

void writeEvemuDescription(std::ostream& file, const TabletDescription& d) {
  char text[80];
  std::snprintf(text, sizeof text, "I: %04x %04x %04x %04x\n", unsigned{d.bus}, unsigned{d.vendor},
                unsigned{d.product}, unsigned{d.version});
  std::string name = d.name;
  std::replace(name.begin(), name.end(), '\n', ' ');
  file << "# EVEMU 1.3\nN: " << name << "\n" << text;
  writeBits(file, "P:", d.properties);
  for (const auto& [type, codes] : d.codes) {
    std::snprintf(text, sizeof text, "B: %02x", unsigned{type});
    writeBits(file, text, codes);
  }
  for (const auto& [code, axis] : d.axes) {
    std::snprintf(text, sizeof text, "A: %02x %d %d %d %d %d\n", unsigned{code}, axis.minimum,
                  axis.maximum, axis.fuzz, axis.flat, axis.resolution);
    file << text;
  }
}

void writeEvemuEvent(std::ostream& file, const InputEvent& event) {
  char text[80];
  std::snprintf(
      text, sizeof text, "E: %lld.%06lld %04x %04x %d\n",
      static_cast<long long>(event.stamp_ns / kNanosecondsPerSecond),
      static_cast<long long>(event.stamp_ns % kNanosecondsPerSecond / kNanosecondsPerMicrosecond),
      unsigned{event.type}, unsigned{event.code}, event.value);
  file << text;
}

}  // namespace calligraphy_brush
