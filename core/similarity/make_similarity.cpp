#include "core/similarity/box_sum.h"
#include "core/similarity/similarity.h"
#include "core/support/errors.h"

namespace saltus {

double lncc_radius_voxels(const SimilarityOptions& parameters, int dimension) {
  if (parameters.lncc_radius_voxels > 0) return parameters.lncc_radius_voxels;
  return dimension == 2 ? 4 : 2;  // measured, core/measurements.md, "Windows of lncc"
}

int lncc_cell(const SimilarityOptions& parameters, int dimension) {
  if (parameters.lncc_cell > 0) return parameters.lncc_cell;
  return dimension == 2 ? 2 : 1;  // as the radius
}

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_similarity(SimilarityType type, const Lattice<Dim>& lattice,
                                                    const SimilarityOptions& parameters, double level_spacing_mm) {
  switch (type) {
    case SimilarityType::Ssd:
      return make_sum_of_squares<Dim, T>(lattice);
    case SimilarityType::Ncc:
      return make_global_correlation<Dim, T>(lattice, parameters.ncc_floor);
    case SimilarityType::Lncc:
      return (lncc_cell(parameters, Dim) == 2
                  ? make_cell_correlation<Dim, T>
                  : make_local_correlation<Dim, T>)(lattice, lncc_radius_voxels(parameters, Dim) * level_spacing_mm,
                                                    parameters.lncc_floor);
    case SimilarityType::Mi:
      return make_mutual_information<Dim, T>(lattice, parameters.mi_bins);
    case SimilarityType::Ngf:
      return make_gradient_fields<Dim, T>(lattice, parameters.ngf_edge);
    case SimilarityType::Mind:
      return make_self_similarity<Dim, T>(lattice, parameters.mind_radius_voxels * level_spacing_mm,
                                          parameters.mind_step_voxels * level_spacing_mm);
  }
  throw InvalidInput("similarity " + std::to_string(static_cast<int>(type)) + " is not known");
}

int similarity_scratch(SimilarityType type, int dimension) {
  const int pairs = 2 * dimension * (dimension - 1);
  switch (type) {
    case SimilarityType::Ssd:
    case SimilarityType::Ncc:
    case SimilarityType::Lncc:
    case SimilarityType::Mi:
      return 0;
    case SimilarityType::Ngf:
      return 2 * dimension;  // what comes back to the differences of both images
    case SimilarityType::Mind:
      return 2 * (pairs / 2) + 3 * pairs;  // distances of both images; context, two duals
  }
  throw InvalidInput("similarity " + std::to_string(static_cast<int>(type)) + " is not known");
}

double similarity_tables(SimilarityType type, const SimilarityOptions& parameters, int threads) {
  switch (type) {
    case SimilarityType::Ssd:
    case SimilarityType::Ncc:
    case SimilarityType::Ngf:
      return 0;
    case SimilarityType::Mind:
      return threads * static_cast<double>(kBoxSumCopy);
    case SimilarityType::Lncc:  // planes of a few rows that fit a second-level cache
      return threads * 1024.0 * 1024.0;
    case SimilarityType::Mi:  // histograms that are filled side by side, and their sum
      return 33.0 * sizeof(double) * (static_cast<double>(parameters.mi_bins) * parameters.mi_bins + 1);
  }
  throw InvalidInput("similarity " + std::to_string(static_cast<int>(type)) + " is not known");
}

template std::unique_ptr<Similarity<2, float>> make_similarity(SimilarityType, const Lattice<2>&,
                                                               const SimilarityOptions&, double);
template std::unique_ptr<Similarity<3, float>> make_similarity(SimilarityType, const Lattice<3>&,
                                                               const SimilarityOptions&, double);
template std::unique_ptr<Similarity<2, double>> make_similarity(SimilarityType, const Lattice<2>&,
                                                                const SimilarityOptions&, double);
template std::unique_ptr<Similarity<3, double>> make_similarity(SimilarityType, const Lattice<3>&,
                                                                const SimilarityOptions&, double);

}  // namespace saltus
