#pragma once

#include <string>

namespace calligraphy_brush {

/// A file that appears whole or not at all.
///
/// Write to temporaryPath(), which lies in the folder of the wanted path, then commit(): a rename
/// within one file system is atomic, so no reader ever sees half a file. Without commit() the
/// destructor removes the temporary and the file that was there before stays as it was.
class AtomicFile {
 public:
  /// Creates the temporary. Throws std::runtime_error with path and reason if the folder does not
  /// exist or cannot be written, or if the path is there and not a regular file.
  explicit AtomicFile(const std::string& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  const std::string& temporaryPath() const { return temporary_path_; }

  /// Puts the temporary in the wanted place. Throws std::runtime_error.
  void commit();

 private:
  std::string path_;
  std::string temporary_path_;
  bool committed_ = false;
};

}  // namespace calligraphy_brush
