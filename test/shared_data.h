#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace calligraphy_brush {

/// Folder of recordings that do not belong to this package: $CALLIGRAPHY_SHARED/data, else
/// ../shared/data beside the source tree. Empty if there is none: tests that need it skip.
inline std::filesystem::path sharedData() {
  namespace fs = std::filesystem;
  const char* given = std::getenv("CALLIGRAPHY_SHARED");
  const fs::path folder = given != nullptr
                              ? fs::path(given) / "data"
                              : fs::path(CALLIGRAPHY_BRUSH_SOURCE_DIR).parent_path() / "shared" / "data";
  std::error_code error;
  return fs::is_directory(folder, error) ? folder : fs::path();
}

}  // namespace calligraphy_brush
