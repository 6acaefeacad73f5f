#include "core/similarity/similarity.h"
#include "core/support/errors.h"

namespace saltus {

template <int Dim, class T>
std::unique_ptr<Similarity<Dim, T>> make_similarity(SimilarityType type, const Lattice<Dim>& lattice,
                                                    const SimilarityOptions& parameters, double level_spacing_mm) {
  switch (type) {
    case SimilarityType::Ssd:
      return make_sum_of_squares<Dim, T>(lattice);
    case SimilarityType::Lncc:
      return make_local_correlation<Dim, T>(lattice, parameters.lncc_radius_voxels * level_spacing_mm,
                                            parameters.lncc_floor);
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
