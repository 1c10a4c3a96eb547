#include "calligraphy_brush/files/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <stdexcept>

namespace calligraphy_brush {
namespace {

[[noreturn]] void fail(const std::string& path, const std::string& reason) {
  throw std::runtime_error("cannot write " + path + ": " + reason);
}

}  // namespace

AtomicFile::AtomicFile(const std::string& path) : path_(path) {
  struct stat status {};
  if (stat(path.c_str(), &status) == 0) {
    if (S_ISDIR(status.st_mode)) fail(path, "it is a folder");
    // A rename would replace a device or a pipe by a file.
    if (!S_ISREG(status.st_mode)) fail(path, "it is not a regular file");
  }
  // open() and not mkstemp(): the file gets the permissions that the umask gives any other file.
  for (int attempt = 0; attempt < 100; ++attempt) {
    const std::string candidate =
        path + "." + std::to_string(getpid()) + "-" + std::to_string(attempt) + ".part";
    const int descriptor = open(candidate.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
    if (descriptor >= 0) {
      close(descriptor);
      temporary_path_ = candidate;
      return;
    }
    if (errno != EEXIST) fail(path, std::strerror(errno));
  }
  fail(path, "too many unfinished files beside it");
}

AtomicFile::~AtomicFile() {
  if (!committed_) unlink(temporary_path_.c_str());
}

void AtomicFile::commit() {
  if (std::rename(temporary_path_.c_str(), path_.c_str()) != 0) fail(path_, std::strerror(errno));
  committed_ = true;
}

}  // namespace calligraphy_brush
