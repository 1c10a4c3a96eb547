#include "calligraphy_brush/files/png.h"

#include <png.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <stdexcept>

#include "calligraphy_brush/files/atomic_file.h"

namespace calligraphy_brush {
namespace {

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

// libpng reports errors by calling this and forbids a return. Throwing through its C frames is what
// it allows C++ callers instead of longjmp, which would skip destructors.
[[noreturn]] void throwPngError(png_structp, png_const_charp message) {
  throw std::runtime_error(message);
}

void ignorePngWarning(png_structp, png_const_charp) {}

struct Writer {
  png_structp png =
      png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, throwPngError, ignorePngWarning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  Writer() = default;
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  ~Writer() { png_destroy_write_struct(&png, &info); }
};

/// A picture of `channels` values of `bits` bits a pixel; values of 16 bits in this machine's order.
struct Rows {
  int width_px, height_px, bits, channels, colour_type;
  const std::uint8_t* data;
  std::size_t value_count;
};

void writeRows(std::FILE* file, const Rows& rows, double px_per_mm) {
  Writer writer;
  if (writer.info == nullptr) throw std::runtime_error("out of memory");
  png_init_io(writer.png, file);
  png_set_IHDR(writer.png, writer.info, static_cast<png_uint_32>(rows.width_px),
               static_cast<png_uint_32>(rows.height_px), rows.bits, rows.colour_type, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  if (px_per_mm > 0) {
    const auto px_per_m = static_cast<png_uint_32>(std::lround(1000.0 * px_per_mm));
    png_set_pHYs(writer.png, writer.info, px_per_m, px_per_m, PNG_RESOLUTION_METER);
  }
  png_write_info(writer.png, writer.info);
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  if (rows.bits == 16) png_set_swap(writer.png);
#endif
  const std::ptrdiff_t row_size = std::ptrdiff_t{rows.width_px} * rows.channels * (rows.bits / 8);
  for (int row = 0; row < rows.height_px; ++row) png_write_row(writer.png, rows.data + row * row_size);
  png_write_end(writer.png, writer.info);
}

void writeFile(const std::string& path, const Rows& rows, double px_per_mm) {
  if (rows.width_px < 1 || rows.height_px < 1 ||
      rows.value_count != static_cast<std::size_t>(rows.width_px) *
                              static_cast<std::size_t>(rows.height_px) *
                              static_cast<std::size_t>(rows.channels))
    throw std::invalid_argument("a picture of " + std::to_string(rows.width_px) + " x " +
                                std::to_string(rows.height_px) + " pixels cannot have " +
                                std::to_string(rows.value_count) + " values");
  AtomicFile output(path);
  File file(std::fopen(output.temporaryPath().c_str(), "wb"));
  try {
    if (!file) throw std::runtime_error(std::strerror(errno));
    writeRows(file.get(), rows, px_per_mm);
    // A full disc shows only when the last buffer goes out.
    if (std::fclose(file.release()) != 0) throw std::runtime_error(std::strerror(errno));
  } catch (const std::runtime_error& error) {
    throw std::runtime_error("cannot write " + path + ": " + error.what());
  }
  output.commit();
}

struct Reader {
  png_structp png =
      png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, throwPngError, ignorePngWarning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  Reader() = default;
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
};

}  // namespace

void writePng(const std::string& path, int width_px, int height_px,
              const std::vector<std::uint8_t>& mono8, double px_per_mm) {
  writeFile(path, {width_px, height_px, 8, 1, PNG_COLOR_TYPE_GRAY, mono8.data(), mono8.size()},
            px_per_mm);
}

void writePng16(const std::string& path, int width_px, int height_px,
                const std::vector<std::uint16_t>& mono16, double px_per_mm) {
  writeFile(path,
            {width_px, height_px, 16, 1, PNG_COLOR_TYPE_GRAY,
             reinterpret_cast<const std::uint8_t*>(mono16.data()), mono16.size()},
            px_per_mm);
}

void writeColourPng(const std::string& path, int width_px, int height_px, Colours colours,
                    const std::vector<std::uint8_t>& values, double px_per_mm) {
  const bool has_alpha = colours == Colours::kRgba;
  writeFile(path,
            {width_px, height_px, 8, has_alpha ? 4 : 3,
             has_alpha ? PNG_COLOR_TYPE_RGB_ALPHA : PNG_COLOR_TYPE_RGB, values.data(), values.size()},
            px_per_mm);
}

GreyPicture readPng(const std::string& path) {
  GreyPicture picture;
  try {
    const File file(std::fopen(path.c_str(), "rb"));
    if (!file) throw std::runtime_error(std::strerror(errno));
    png_byte signature[8] = {};
    if (std::fread(signature, 1, 8, file.get()) != 8 || png_sig_cmp(signature, 0, 8) != 0)
      throw std::runtime_error("not a PNG file");
    Reader reader;
    if (reader.info == nullptr) throw std::runtime_error("out of memory");
    png_init_io(reader.png, file.get());
    png_set_sig_bytes(reader.png, 8);
    png_read_info(reader.png, reader.info);
    png_set_expand(reader.png);
    png_set_strip_16(reader.png);
    png_set_strip_alpha(reader.png);
    const auto colour = png_get_color_type(reader.png, reader.info);
    if (colour != PNG_COLOR_TYPE_GRAY && colour != PNG_COLOR_TYPE_GRAY_ALPHA)
      png_set_rgb_to_gray_fixed(reader.png, PNG_ERROR_ACTION_NONE, PNG_RGB_TO_GRAY_DEFAULT,
                                PNG_RGB_TO_GRAY_DEFAULT);
    const int passes = png_set_interlace_handling(reader.png);
    png_read_update_info(reader.png, reader.info);
    picture.width_px = static_cast<int>(png_get_image_width(reader.png, reader.info));
    picture.height_px = static_cast<int>(png_get_image_height(reader.png, reader.info));
    picture.mono8.resize(static_cast<std::size_t>(picture.width_px) *
                         static_cast<std::size_t>(picture.height_px));
    for (int pass = 0; pass < passes; ++pass)
      for (int row = 0; row < picture.height_px; ++row)
        png_read_row(reader.png,
                     picture.mono8.data() + static_cast<std::ptrdiff_t>(row) * picture.width_px,
                     nullptr);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error("cannot read " + path + ": " + error.what());
  }
  return picture;
}

}  // namespace calligraphy_brush
