#include "core/similarity/similarity.h"
#include "core/support/reduction.h"

namespace saltus {
namespace {

template <int Dim, class T>
class SumOfSquares final : public Similarity<Dim, T> {
 public:
  explicit SumOfSquares(const Lattice<Dim>& lattice) : sites_(lattice.sites()), volume_(lattice.cell_volume()) {}

  double evaluate(const T* fixed, const T* warped, const T* weights, T* gradient, T* weight_gradient) override {
    return ordered_sum(sites_, [&](std::size_t i) {
      const T difference = warped[i] - fixed[i];
      const T weight = weights ? weights[i] : T(1);
      const T volume = static_cast<T>(volume_);
      if (weight_gradient) weight_gradient[i] = volume * difference * difference;
      if (weight == 0) {  // not a product with 0: what is hidden may be NaN
        gradient[i] = 0;
        return 0.0;
      }
      gradient[i] = 2 * volume * weight * difference;
      return volume_ * weight * difference * difference;
    });
  }

 private:
  std::size_t sites_;
  double volume_;
};

}  // namespace

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_sum_of_squares(const Lattice<Dim>& lattice) {
  return std::make_unique<SumOfSquares<Dim, T>>(lattice);
}

template std::unique_ptr<Similarity<2, float>> make_sum_of_squares(const Lattice<2>&);
template std::unique_ptr<Similarity<3, float>> make_sum_of_squares(const Lattice<3>&);
template std::unique_ptr<Similarity<2, double>> make_sum_of_squares(const Lattice<2>&);
template std::unique_ptr<Similarity<3, double>> make_sum_of_squares(const Lattice<3>&);

}  // namespace saltus
