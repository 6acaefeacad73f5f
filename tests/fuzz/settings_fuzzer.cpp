// Any name and value as an expert parameter, as --set and the specification give them: "name=value".
#include "core/registration/options.h"
#include "core/support/errors.h"

#include <cstdint>
#include <string>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace saltus;
  const std::string text(reinterpret_cast<const char*>(data), size);
  RegistrationOptions options = default_options(Model{}, SimilarityType{}, Preset{});
  // The names, so that values are reached however long the names are.
  const auto parameters = list_parameters(options);
  const auto equals = text.find('=');
  try {
    if (equals != std::string::npos) {
      set_parameter(options, text.substr(0, equals), text.substr(equals + 1));
    } else if (size > 0) {
      set_parameter(options, parameters[data[0] % parameters.size()].name, text.substr(1));
    }
  } catch (const InvalidInput&) {
    return 0;
  }
  for (const std::string& problem : problems(options))
    if (problem.empty()) __builtin_trap();
  return 0;
}
