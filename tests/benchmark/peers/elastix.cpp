#include <fstream>
#include <sstream>
#include <stdexcept>

#include "tests/benchmark/peers/methods.h"

namespace saltus::benchmark {
namespace {

class Elastix final : public Method {
 public:
  Elastix(std::filesystem::path elastix, std::filesystem::path transformix)
      : elastix_(std::move(elastix)), transformix_(std::move(transformix)) {}

  std::string family() const override { return "elastix"; }
  std::string setting(const PeerPair& pair, int threads) const override {
    return "elastix, " + std::to_string(threads) + " threads\n" + elastix_parameters(pair);
  }

  MethodRun run(const PeerPair& pair, int threads, const std::filesystem::path& folder) const override {
    const std::filesystem::path parameters = folder / "parameters.txt";
    std::ofstream(parameters) << elastix_parameters(pair);
    const std::string count = std::to_string(threads);
    MethodRun result;
    const auto must = [&](const std::vector<std::string>& command, const char* log) {
      const ProcessCost cost = run_measured(command, {}, folder / log);
      if (cost.exit_code != 0)
        throw std::runtime_error(command.front() + " ended with exit code " + std::to_string(cost.exit_code) +
                                 ", see " + (folder / log).string());
      return cost;
    };
    result.cost =
        must({elastix_, "-f", pair.fixed, "-m", pair.moving, "-out", folder, "-p", parameters, "-threads", count},
             "elastix_output.txt");
    must({transformix_, "-tp", folder / "TransformParameters.0.txt", "-def", "all", "-in", pair.moving, "-out", folder,
          "-threads", count},
         "transformix_output.txt");
    result.displacement = folder / "deformationField.mha";
    result.warped = folder / "result.mha";
    return result;
  }

 private:
  std::filesystem::path elastix_, transformix_;
};

}  // namespace

std::string elastix_parameters(const PeerPair& pair) {
  std::ostringstream out;
  const auto word = [&](const char* name, const std::string& value) {
    out << '(' << name << " \"" << value << "\")\n";
  };
  const auto number = [&](const char* name, double value) { out << '(' << name << ' ' << value << ")\n"; };
  word("FixedInternalImagePixelType", "float");
  word("MovingInternalImagePixelType", "float");
  number("FixedImageDimension", pair.dimension);
  number("MovingImageDimension", pair.dimension);
  word("UseDirectionCosines", "true");
  word("Registration", "MultiResolutionRegistration");
  word("FixedImagePyramid", "FixedSmoothingImagePyramid");
  word("MovingImagePyramid", "MovingSmoothingImagePyramid");
  number("NumberOfResolutions", pair.dimension == 2 ? 3 : 4);
  word("Transform", "BSplineTransform");
  number("FinalGridSpacingInPhysicalUnits", pair.grid_mm);
  word("HowToCombineTransforms", "Compose");
  word("Metric", pair.similarity == SimilarityType::Ssd ? "AdvancedMeanSquares" : "AdvancedNormalizedCorrelation");
  word("Optimizer", "AdaptiveStochasticGradientDescent");
  word("AutomaticParameterEstimation", "true");
  number("MaximumNumberOfIterations", 500);
  word("ImageSampler", "RandomCoordinate");
  word("NewSamplesEveryIteration", "true");
  number("NumberOfSpatialSamples", pair.dimension == 2 ? 2048 : 4096);
  word("Interpolator", "LinearInterpolator");
  word("ResampleInterpolator", "FinalBSplineInterpolator");
  number("FinalBSplineInterpolationOrder", 1);
  word("Resampler", "DefaultResampler");
  number("DefaultPixelValue", 0);
  word("WriteResultImage", "false");
  word("ResultImageFormat", "mha");
  word("ResultImagePixelType", "float");
  return out.str();
}

std::unique_ptr<Method> make_elastix(const std::filesystem::path& elastix, const std::filesystem::path& transformix) {
  return std::make_unique<Elastix>(elastix, transformix);
}

}  // namespace saltus::benchmark
