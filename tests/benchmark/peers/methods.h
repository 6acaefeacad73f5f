#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "tests/benchmark/measured_process.h"
#include "tests/benchmark/peers/peer_pair.h"

namespace saltus::benchmark {

/// What one run of a method has given.
struct MethodRun {
  ProcessCost cost;                    ///< of the whole program: reading, registering, writing
  double registration_cpu = -1;        ///< of the registration alone, where the program says it
  std::filesystem::path displacement;  ///< mm (LPS) on the fixed grid, fixed(x) ~ moving(x + u(x))
  std::filesystem::path warped;        ///< the moving image as the method itself has moved it
};

/// A program with a choice of parameters.
class Method {
 public:
  virtual ~Method() = default;
  /// Name in tables and of its curve: "saltus", "elastix".
  virtual std::string family() const = 0;
  /// Of this choice: "fast"; empty where there is but one.
  virtual std::string choice() const { return {}; }
  /// All that decides what comes out, but the images: program, version, parameters.
  virtual std::string setting(const PeerPair& pair, int threads) const = 0;
  /// Runs in `folder`, which is empty. Throws std::runtime_error with the log's name when the program fails.
  virtual MethodRun run(const PeerPair& pair, int threads, const std::filesystem::path& folder) const = 0;

  std::string name() const { return choice().empty() ? family() : family() + " " + choice(); }
};

/// `saltus register` with its private daemon and worker, report and all.
std::unique_ptr<Method> make_saltus(const std::filesystem::path& program, const std::string& model,
                                    const std::string& preset);

/// Multi-resolution B-splines by adaptive stochastic gradient descent. `transformix`, which makes the field, is not
/// counted.
std::unique_ptr<Method> make_elastix(const std::filesystem::path& elastix, const std::filesystem::path& transformix);

/// Multi-stage B-splines by L-BFGS-B. Its images are 3-D: a 2-D pair becomes four equal slices.
/// `smoothness` is its regularization_lambda.
std::unique_ptr<Method> make_plastimatch(const std::filesystem::path& program, const std::string& smoothness);

/// The text of their parameter files, for images of these grids.
std::string elastix_parameters(const PeerPair& pair);
std::string plastimatch_parameters(const PeerPair& pair, const std::string& smoothness,
                                   const std::vector<double>& spacing, const std::filesystem::path& fixed,
                                   const std::filesystem::path& moving, const std::filesystem::path& folder);

}  // namespace saltus::benchmark
