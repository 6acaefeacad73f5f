#include "client/cli/file_format.h"

#include "core/support/errors.h"

#include <algorithm>
#include <cctype>
#include <vector>

namespace saltus::cli {
namespace {

std::string format_among(const std::string& option, const std::filesystem::path& file,
                         const std::vector<std::string>& formats) {
  std::string name = file.filename().string();
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
  std::string allowed;
  for (const std::string& format : formats) {
    if (name.ends_with("." + format)) return format;
    allowed += (allowed.empty() ? "." : ", .") + format;
  }
  throw InvalidInput(option + " is " + file.string() + ", whose name does not say a format; it must end in " +
                     (formats.size() == 1 ? "" : "one of ") + allowed);
}

}  // namespace

std::string image_format(const std::string& option, const std::filesystem::path& file) {
  return format_among(option, file, {"mha", "nii", "nii.gz", "nrrd", "png"});
}

std::string points_format(const std::string& option, const std::filesystem::path& file) {
  return format_among(option, file, {"csv"});
}

}  // namespace saltus::cli
