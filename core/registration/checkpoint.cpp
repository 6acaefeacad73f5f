#include "core/registration/checkpoint.h"

#include "core/registration/register_images.h"
#include "core/support/errors.h"
#include "core/support/fingerprint.h"
#include "core/support/short_float.h"

#include <algorithm>
#include <cstring>
#include <istream>
#include <ostream>
#include <type_traits>

namespace saltus {
namespace {

constexpr char kMagic[8] = {'S', 'A', 'L', 'T', 'U', 'S', 'C', 'P'};
/// To be raised with every change of what is stored or of what is computed from it.
constexpr std::uint32_t kVersion = 42;

struct Header {
  char magic[8];
  std::uint32_t version;
  std::uint32_t unused;
  std::uint64_t job, size, checksum;  ///< of what follows
};
static_assert(std::is_trivially_copyable_v<Header> && sizeof(Header) == 40);

/// What is stored as the bytes that it has.
template <class T>
concept Plain = std::is_arithmetic_v<T> || std::is_same_v<T, ShortFloat>;

/// Passes every value on as bytes, lists after the number of what they hold.
template <class Take>
class Writer {
 public:
  explicit Writer(Take take) : take_(std::move(take)) {}

  template <class T>
  requires(std::is_arithmetic_v<T> || std::is_enum_v<T>) void operator()(const T& value) {
    take_(&value, sizeof value);
  }
  template <Plain T>
  void operator()(const std::vector<T>& values) {
    (*this)(static_cast<std::uint64_t>(values.size()));
    take_(values.data(), values.size() * sizeof(T));
  }
  void operator()(const std::string& text) {
    (*this)(static_cast<std::uint64_t>(text.size()));
    take_(text.data(), text.size());
  }
  template <class List, class Each>
  void list(const List& values, Each&& each) {
    (*this)(static_cast<std::uint64_t>(values.size()));
    for (const auto& value : values) each(*this, value);
  }

 private:
  Take take_;
};

[[noreturn]] void damaged(const std::string& what) {
  throw InvalidInput("the checkpoint is damaged, " + what + "; start again without it");
}

/// The opposite, of a body of known size.
class Reader {
 public:
  Reader(std::istream& in, std::uint64_t size) : in_(in), left_(size) {}

  template <class T>
  requires(std::is_arithmetic_v<T> || std::is_enum_v<T>) void operator()(T& value) { copy(&value, 1); }
  template <Plain T>
  void operator()(std::vector<T>& values) {
    values.resize(count(sizeof(T)));
    copy(values.data(), values.size());
  }
  void operator()(std::string& text) {
    text.resize(count(1));
    copy(text.data(), text.size());
  }
  template <class List, class Each>
  void list(List& values, Each&& each) {
    values.resize(count(1));
    for (auto& value : values) each(*this, value);
  }
  bool is_at_end() const { return left_ == 0; }

 private:
  /// A number of things of which each takes at least `size` bytes.
  std::size_t count(std::size_t size) {
    std::uint64_t found = 0;
    (*this)(found);
    if (found > left_ / size) damaged("what it holds does not fit together");
    return static_cast<std::size_t>(found);
  }
  template <class T>
  void copy(T* to, std::size_t values) {
    const std::size_t size = values * sizeof(T);
    if (size > left_) damaged("what it holds does not fit together");
    if (!in_.read(reinterpret_cast<char*>(to), static_cast<std::streamsize>(size))) damaged("it cannot be read");
    left_ -= size;
  }

  std::istream& in_;
  std::uint64_t left_;
};

/// Of `size` bytes from where the stream stands.
std::uint64_t checksum(std::istream& in, std::uint64_t size) {
  Fingerprint fingerprint;
  std::vector<char> piece(1 << 16);
  while (size > 0) {
    const auto length = static_cast<std::size_t>(std::min<std::uint64_t>(size, piece.size()));
    if (!in.read(piece.data(), static_cast<std::streamsize>(length))) damaged("it cannot be read");
    fingerprint.add_bytes(piece.data(), length);
    size -= length;
  }
  return fingerprint.value();
}

template <class Stream, class Level>
void transfer_level(Stream& stream, Level& level) {
  stream(level.level);
  stream(level.grid);
  stream(level.spacing_mm);
  stream(level.iterations);
  stream(level.evaluations);
  stream(level.rounds);
  stream(level.optimality);
  stream(level.smoothing_voxels);
  stream(level.similarity_weight);
  stream(level.energy_before);
  stream(level.energy_after);
  stream(level.termination);
  stream(level.active_block_share);
  stream(level.kept_out_share);
  stream(level.decision);
  stream(level.simple_shear);
  stream(level.has_finer);
  stream(level.was_plain);
  stream(level.quick_share);
  stream(level.quick_after);
  stream(level.gave_up_sharp);
  stream(level.shear_before);
  stream(level.narrow_share);
  stream(level.narrow_pull);
  stream(level.own_pull);
  stream(level.has_narrower);
  stream(level.oriented_elements);
  stream(level.map_steps);
  stream(level.map_error_mm);
  stream(level.oblique_share);
  stream(level.seconds);
  stream(level.cpu_seconds);
}

/// One description of the layout for both directions.
template <class Stream, class State>
void transfer(Stream& stream, State& at) {
  stream(at.step);
  transfer_level(stream, at.level);
  stream(at.level_start);
  stream(at.optimality_reference);
  stream.list(at.sparsity_factors, [](auto& s, auto& factors) { s(factors); });
  stream.list(at.active_blocks, [](auto& s, auto& blocks) { s(blocks); });
  stream.list(at.active_elements, [](auto& s, auto& elements) { s(elements); });
  stream.list(at.turned_normals, [](auto& s, auto& normals) { s(normals); });
  stream.list(at.turned_elements, [](auto& s, auto& elements) { s(elements); });
  stream(at.minimiser.x);
  stream(at.minimiser.gradient);
  stream(at.minimiser.preconditioned);
  stream.list(at.minimiser.pairs, [](auto& s, auto& pair) {
    s(pair.s);
    s(pair.y);
    s(pair.y_preconditioned);
    s(pair.rho);
  });
  stream(at.minimiser.energies);
  stream(at.minimiser.first_optimality);
  stream(at.minimiser.noise_optimality);
  stream(at.minimiser.evaluations);
  stream(at.minimiser.looked_at);
  stream(at.minimiser.look_gap);
  stream(at.minimiser.revised_at);
  stream(at.minimiser.settled_at);
  stream.list(at.levels, [](auto& s, auto& level) { transfer_level(s, level); });
  stream.list(at.history, [](auto& s, auto& record) {
    s(record.level);
    s(record.round);
    s(record.iteration);
    s(record.energy);
    s(record.similarity);
    s(record.regularisation);
    s(record.sparsity);
    s(record.step);
    s(record.optimality);
  });
  stream(at.seconds);
  stream(at.cpu_seconds);
}

template <int Dim>
void add(Fingerprint& fingerprint, const ImageGrid<Dim>& grid) {
  for (int axis = 0; axis < Dim; ++axis) {
    fingerprint.add(grid.size[axis]);
    fingerprint.add(grid.spacing[axis]);
    fingerprint.add(grid.origin[axis]);
    for (int row = 0; row < Dim; ++row) fingerprint.add(grid.direction(row, axis));
  }
}

template <int Dim>
void add(Fingerprint& fingerprint, const Volume<Dim>& volume) {
  add(fingerprint, volume.grid);
  fingerprint.add(volume.samples);
}

}  // namespace

template <int Dim>
std::uint64_t job_fingerprint(const RegistrationInput<Dim>& input, const RegistrationOptions& asked) {
  Fingerprint fingerprint;
  fingerprint.add(Dim);
  add(fingerprint, input.fixed);
  add(fingerprint, input.moving);
  for (const std::optional<Volume<Dim>>* mask : {&input.fixed_mask, &input.moving_mask}) {
    fingerprint.add(mask->has_value());
    if (*mask) add(fingerprint, **mask);
  }
  fingerprint.add(input.direction.has_value());
  if (input.direction) {
    add(fingerprint, input.direction->grid);
    fingerprint.add(input.direction->samples);
  }
  for (int row = 0; row < Dim; ++row) {
    fingerprint.add(input.start.offset[row]);
    for (int column = 0; column < Dim; ++column) fingerprint.add(input.start.linear(row, column));
  }
  fingerprint.add(to_string(asked.model));
  fingerprint.add(to_string(asked.similarity));
  fingerprint.add(to_string(asked.preset));
  for (const ParameterInfo& parameter : list_parameters(asked)) {
    fingerprint.add(parameter.name);
    fingerprint.add(parameter.value);
  }
  return fingerprint.value();
}

void encode(const Checkpoint& checkpoint, std::uint64_t job, std::ostream& out) {
  Header header{};
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  header.version = kVersion;
  header.job = job;
  Fingerprint fingerprint;
  Writer count([&](const void* data, std::size_t size) {
    header.size += size;
    fingerprint.add_bytes(data, size);
  });
  transfer(count, checkpoint);
  header.checksum = fingerprint.value();
  Writer write(
      [&out](const void* data, std::size_t size) { out.write(static_cast<const char*>(data), std::streamsize(size)); });
  out.write(reinterpret_cast<const char*>(&header), sizeof header);
  transfer(write, checkpoint);
}

Checkpoint decode(std::istream& in, std::uint64_t job) {
  in.seekg(0, std::ios::end);
  const auto length = static_cast<std::uint64_t>(std::max<std::streamoff>(0, in.tellg()));
  in.seekg(0);
  Header header;
  if (length < sizeof header)
    throw InvalidInput("the checkpoint has " + std::to_string(length) + " bytes, which is less than its header of " +
                       std::to_string(sizeof header) + "; start again without it");
  if (!in.read(reinterpret_cast<char*>(&header), sizeof header)) damaged("it cannot be read");
  const std::uint64_t size = length - sizeof header;
  if (std::memcmp(header.magic, kMagic, sizeof kMagic) != 0)
    throw InvalidInput("the checkpoint is not one that register_images made; start again without it");
  if (header.version != kVersion)
    throw InvalidInput("the checkpoint has version " + std::to_string(header.version) + " and this program reads " +
                       std::to_string(kVersion) + "; start again without it");
  if (header.size != size)
    throw InvalidInput("the checkpoint is cut off, it has " + std::to_string(size) + " of " +
                       std::to_string(header.size) + " bytes; start again without it");
  // Before anything is believed of what it holds.
  if (header.checksum != checksum(in, size)) damaged("its checksum does not match");
  if (header.job != job)
    throw InvalidInput(
        "the checkpoint belongs to another registration; give the images and options that it was made with, or start "
        "again without it");
  in.seekg(sizeof header);
  Checkpoint checkpoint;
  Reader reader(in, size);
  transfer(reader, checkpoint);
  if (!reader.is_at_end()) damaged("it holds more than it should");
  return checkpoint;
}

template std::uint64_t job_fingerprint(const RegistrationInput<2>&, const RegistrationOptions&);
template std::uint64_t job_fingerprint(const RegistrationInput<3>&, const RegistrationOptions&);

}  // namespace saltus
