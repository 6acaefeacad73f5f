#include "core/image_io/meta_header.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "core/support/errors.h"

namespace saltus {
namespace {

// ITK's reader copies values into fields of 255 characters without looking at their length.
constexpr std::size_t kLongestLine = 250, kLongestHeader = 1 << 16;
constexpr std::uint64_t kMostVoxels = std::uint64_t{1} << 31;
constexpr int kMostComponents = 16;
// Deflate cannot make anything smaller than by a factor of 1032.
constexpr std::uint64_t kStrongestCompression = 1032;

/// What stands after the equals sign.
enum class Kind {
  Text,
  Flag,            ///< true or false
  Integer,         ///< one whole number
  Number,          ///< one finite number
  FourNumbers,     ///< a colour
  IntegerPerAxis,  ///< as many whole numbers as there are axes
  NumberPerAxis,
  Matrix,  ///< as many numbers as axes times axes
};

Kind kind_of(std::string_view key) {
  static const std::map<std::string_view, Kind> kinds{
      {"NDims", Kind::Integer},
      {"ID", Kind::Integer},
      {"ParentID", Kind::Integer},
      {"HeaderSize", Kind::Integer},
      {"ElementNBits", Kind::Integer},
      {"ElementNumberOfChannels", Kind::Integer},
      {"CompressedDataSize", Kind::Integer},
      {"CompressedData", Kind::Flag},
      {"BinaryData", Kind::Flag},
      {"BinaryDataByteOrderMSB", Kind::Flag},
      {"ElementByteOrderMSB", Kind::Flag},
      {"Color", Kind::FourNumbers},
      {"DimSize", Kind::IntegerPerAxis},
      {"SequenceID", Kind::IntegerPerAxis},
      {"Position", Kind::NumberPerAxis},
      {"Origin", Kind::NumberPerAxis},
      {"Offset", Kind::NumberPerAxis},
      {"ImagePosition", Kind::NumberPerAxis},
      {"CenterOfRotation", Kind::NumberPerAxis},
      {"ElementSpacing", Kind::NumberPerAxis},
      {"ElementSize", Kind::NumberPerAxis},
      {"TransformMatrix", Kind::Matrix},
      {"Rotation", Kind::Matrix},
      {"Orientation", Kind::Matrix},
      {"ElementMin", Kind::Number},
      {"ElementMax", Kind::Number},
      {"ElementToIntensityFunctionSlope", Kind::Number},
      {"ElementToIntensityFunctionOffset", Kind::Number},
  };
  const auto found = kinds.find(key);
  return found == kinds.end() ? Kind::Text : found->second;
}

/// Bytes of one number; 0 for what is no type of voxels.
std::uint64_t bytes_of(std::string_view type) {
  static const std::map<std::string_view, std::uint64_t> types{
      {"MET_CHAR", 1},      {"MET_UCHAR", 1},      {"MET_SHORT", 2}, {"MET_USHORT", 2},
      {"MET_INT", 4},       {"MET_UINT", 4},       {"MET_LONG", 4},  {"MET_ULONG", 4},
      {"MET_LONG_LONG", 8}, {"MET_ULONG_LONG", 8}, {"MET_FLOAT", 4}, {"MET_DOUBLE", 8},
  };
  const auto found = types.find(type);
  return found == types.end() ? 0 : found->second;
}

bool is_blank(char c) { return c == ' ' || c == '\t'; }

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back())) text.remove_suffix(1);
  return text;
}

template <typename Value>
std::optional<Value> parse(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  Value value{};
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value;
}

class HeaderReader {
 public:
  explicit HeaderReader(const std::filesystem::path& path) : name_(path.filename().string()) {
    std::ifstream file(path, std::ios::binary);
    if (!file) refuse("it cannot be opened");
    std::error_code error;
    file_size_ = std::filesystem::file_size(path, error);
    if (error) refuse(error.message());
    text_.resize(kLongestHeader);
    file.read(text_.data(), static_cast<std::streamsize>(text_.size()));
    text_.resize(static_cast<std::size_t>(file.gcount()));
  }

  MetaHeader read() {
    for (std::size_t begin = 0; begin < text_.size();) {
      const std::size_t end = text_.find('\n', begin);
      // A last line without an end counts as one that is too long: there are no voxels behind it either way.
      const std::size_t length = std::min(end, text_.size()) - begin;
      if (length > kLongestLine)
        refuse("its header has a line of more than " + std::to_string(kLongestLine) + " characters; shorten it");
      if (end == std::string::npos) break;
      if (read_line(std::string_view(text_).substr(begin, length))) {
        header_.data_offset = end + 1;
        check_whole();
        return header_;
      }
      begin = end + 1;
    }
    refuse("its header has no line ElementDataFile");
  }

 private:
  [[noreturn]] void refuse(const std::string& reason) const { throw FileError("cannot read " + name_ + ": " + reason); }

  /// Whether it was the last line.
  bool read_line(std::string_view line) {
    if (line.ends_with('\r')) line.remove_suffix(1);
    for (const char c : line)
      if ((c >= 0 && c < ' ' && c != '\t') || c == 127) refuse("its header has a character that is no text");
    const std::size_t equals = line.find('=');
    const std::string key(trimmed(line.substr(0, equals)));
    if (equals == std::string_view::npos || key.empty() || key.find(':') != std::string::npos)
      refuse("its header has a line that is not of the form 'Key = value'");
    const std::string_view value = trimmed(line.substr(equals + 1));
    const Kind kind = kind_of(key);
    // Our sentence about a key that the format does not know must not repeat a stranger's text.
    if (!seen_.insert(key).second) refuse("its header has " + (kind == Kind::Text ? "a key" : key) + " twice");
    if (kind == Kind::Flag) {
      flags_[key] = read_flag(key, value);
    } else if (kind != Kind::Text) {
      read_numbers(key, kind, value);
    } else if (key == "ElementType") {
      element_bytes_ = bytes_of(value);
      if (element_bytes_ == 0) refuse("its voxels are of an ElementType that does not exist or is not supported");
    } else if (key == "ElementDataFile") {
      if (value != "LOCAL" && value != "Local" && value != "local")
        refuse("its voxels are in another file; save header and voxels in one .mha file");
      return true;
    }
    return false;
  }

  bool read_flag(const std::string& key, std::string_view value) const {
    std::string word(value);
    std::transform(word.begin(), word.end(), word.begin(), [](unsigned char c) { return std::tolower(c); });
    if (word == "true" || word == "1") return true;
    if (word == "false" || word == "0") return false;
    refuse("its header's " + key + " is neither True nor False");
  }

  std::size_t count_of(const std::string& key, Kind kind) const {
    if (kind == Kind::Integer || kind == Kind::Number) return 1;
    if (kind == Kind::FourNumbers) return 4;
    if (header_.dimension == 0) refuse("its header has " + key + " before NDims");
    const std::size_t axes = static_cast<std::size_t>(header_.dimension);
    return kind == Kind::Matrix ? axes * axes : axes;
  }

  void read_numbers(const std::string& key, Kind kind, std::string_view value) {
    const bool is_whole = kind == Kind::Integer || kind == Kind::IntegerPerAxis;
    const std::size_t count = count_of(key, kind);
    std::vector<std::int64_t> whole;
    std::size_t found = 0;
    for (std::string_view rest = value; !rest.empty(); ++found) {
      const std::size_t end = std::min(rest.find_first_of(" \t"), rest.size());
      const std::string_view word = rest.substr(0, end);
      rest = trimmed(rest.substr(end));
      if (is_whole) {
        const auto number = parse<std::int64_t>(word);
        // ITK has 32 bits for all of these but one.
        const bool is_long = key == "CompressedDataSize";
        if (!number || (!is_long && *number != static_cast<std::int32_t>(*number)))
          refuse("its header's " + key + " is not made of whole numbers");
        whole.push_back(*number);
      } else if (const auto number = parse<double>(word); !number || !std::isfinite(*number)) {
        refuse("its header's " + key + " is not made of finite numbers");
      }
    }
    if (found != count)
      refuse("its header's " + key + " has " + std::to_string(found) + " numbers where " + std::to_string(count) +
             " belong");
    if (is_whole) take(key, whole);
  }

  void take(const std::string& key, const std::vector<std::int64_t>& numbers) {
    const std::int64_t number = numbers.front();
    if (key == "NDims") {
      if (number < 1 || number > MetaHeader::most_dimensions)
        refuse("its header has " + std::to_string(number) + " dimensions");
      header_.dimension = static_cast<int>(number);
    } else if (key == "DimSize") {
      // What is negative becomes too large.
      std::copy(numbers.begin(), numbers.end(), header_.size.begin());
    } else if (key == "ElementNumberOfChannels") {
      if (number < 1 || number > kMostComponents) refuse("it has " + std::to_string(number) + " components a voxel");
      header_.components = static_cast<int>(number);
    } else if (key == "HeaderSize" && number != 0) {
      refuse("its header's HeaderSize is " + std::to_string(number) + "; the voxels of a .mha follow its header");
    } else if (key == "CompressedDataSize") {
      if (number < 0) refuse("its header's CompressedDataSize is negative");
      header_.compressed_bytes = static_cast<std::uint64_t>(number);
    }
  }

  std::string size_text() const {
    std::string text;
    for (int axis = 0; axis < header_.dimension; ++axis)
      text += (axis > 0 ? "x" : "") + std::to_string(static_cast<std::int64_t>(header_.size[axis]));
    return text;
  }

  void check_whole() {
    for (const char* key : {"NDims", "DimSize", "ElementType"})
      if (!seen_.contains(key)) refuse(std::string("its header has no line ") + key);
    std::uint64_t voxels = 1;
    for (int axis = 0; axis < header_.dimension; ++axis) {
      if (header_.size[axis] < 1 || header_.size[axis] > kMostVoxels / voxels)
        refuse("its size " + size_text() + " is not between 1 and 2^31 voxels");
      voxels *= header_.size[axis];
    }
    const std::uint64_t numbers = voxels * static_cast<std::uint64_t>(header_.components);
    header_.voxel_bytes = numbers * element_bytes_;
    // ITK's reader takes voxels for text unless it is told otherwise.
    header_.is_text = !flag("BinaryData");
    header_.is_compressed = flag("CompressedData");
    if (header_.is_text && header_.is_compressed) refuse("its voxels are text and compressed at once");

    const std::uint64_t stored = file_size_ - header_.data_offset;
    std::uint64_t most = stored;
    if (header_.is_compressed) {
      if (header_.compressed_bytes < 1 || header_.compressed_bytes > stored)
        refuse("its CompressedDataSize is " + std::to_string(header_.compressed_bytes) + " where " +
               std::to_string(stored) + " bytes follow the header; it is cut off or damaged");
      most = kStrongestCompression * header_.compressed_bytes;
    }
    // A number that is written out has a digit at least, and a blank before the next.
    const std::uint64_t needed = header_.is_text ? 2 * numbers - 1 : header_.voxel_bytes;
    if (needed > most)
      refuse("its header promises " + size_text() + " voxels, more than its " + std::to_string(file_size_) +
             " bytes can hold; it is cut off or damaged");
  }

  bool flag(const char* key) const {
    const auto found = flags_.find(key);
    return found != flags_.end() && found->second;
  }

  std::string name_, text_;
  std::uint64_t file_size_ = 0;
  MetaHeader header_;
  std::set<std::string> seen_;
  std::map<std::string, bool> flags_;
  std::uint64_t element_bytes_ = 0;
};

}  // namespace

MetaHeader read_meta_header(const std::filesystem::path& path) { return HeaderReader(path).read(); }

}  // namespace saltus
