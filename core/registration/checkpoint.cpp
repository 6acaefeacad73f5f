#include "core/registration/checkpoint.h"

#include "core/registration/register_images.h"
#include "core/support/errors.h"
#include "core/support/fingerprint.h"

#include <cstring>
#include <type_traits>

namespace saltus {
namespace {

constexpr char kMagic[8] = {'S', 'A', 'L', 'T', 'U', 'S', 'C', 'P'};
/// To be raised with every change of what is stored or of what is computed from it.
constexpr std::uint32_t kVersion = 13;

struct Header {
  char magic[8];
  std::uint32_t version;
  std::uint32_t unused;
  std::uint64_t job, size, checksum;  ///< of what follows
};
static_assert(std::is_trivially_copyable_v<Header> && sizeof(Header) == 40);

std::uint64_t checksum(std::string_view bytes) {
  Fingerprint fingerprint;
  fingerprint.add_bytes(bytes.data(), bytes.size());
  return fingerprint.value();
}

class Writer {
 public:
  template <class T>
  requires(std::is_arithmetic_v<T> || std::is_enum_v<T>) void operator()(const T& value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(const std::vector<T>& values) {
    (*this)(static_cast<std::uint64_t>(values.size()));
    bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  void operator()(const std::string& text) {
    (*this)(static_cast<std::uint64_t>(text.size()));
    bytes += text;
  }
  template <class List, class Each>
  void list(const List& values, Each&& each) {
    (*this)(static_cast<std::uint64_t>(values.size()));
    for (const auto& value : values) each(*this, value);
  }

  std::string bytes;
};

/// How many bytes a Writer would write.
class Counter {
 public:
  template <class T>
  requires(std::is_arithmetic_v<T> || std::is_enum_v<T>) void operator()(const T& value) { size += sizeof value; }
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(const std::vector<T>& values) { size += sizeof(std::uint64_t) + values.size() * sizeof(T); }
  void operator()(const std::string& text) { size += sizeof(std::uint64_t) + text.size(); }
  template <class List, class Each>
  void list(const List& values, Each&& each) {
    size += sizeof(std::uint64_t);
    for (const auto& value : values) each(*this, value);
  }

  std::size_t size = 0;
};

class Reader {
 public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}

  template <class T>
  requires(std::is_arithmetic_v<T> || std::is_enum_v<T>) void operator()(T& value) { copy(&value, 1); }
  template <class T>
  requires std::is_arithmetic_v<T>
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
  bool is_at_end() const { return bytes_.empty(); }

 private:
  /// A number of things of which each takes at least `size` bytes.
  std::size_t count(std::size_t size) {
    std::uint64_t found = 0;
    (*this)(found);
    if (found > bytes_.size() / size) damaged();
    return static_cast<std::size_t>(found);
  }
  template <class T>
  void copy(T* to, std::size_t values) {
    const std::size_t size = values * sizeof(T);
    if (size > bytes_.size()) damaged();
    if (size > 0) std::memcpy(to, bytes_.data(), size);
    bytes_.remove_prefix(size);
  }
  [[noreturn]] static void damaged() {
    throw InvalidInput("the checkpoint is damaged, what it holds does not fit together; start again without it");
  }

  std::string_view bytes_;
};

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
  stream(level.decision);
  stream(level.first_order_gain);
  stream(level.first_order_shear);
  stream(level.oriented_elements);
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
std::uint64_t job_fingerprint(const RegistrationInput<Dim>& input, const RegistrationOptions& resolved) {
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
  fingerprint.add(to_string(resolved.model));
  fingerprint.add(to_string(resolved.similarity));
  for (const ParameterInfo& parameter : list_parameters(resolved)) {
    fingerprint.add(parameter.name);
    fingerprint.add(parameter.value);
  }
  return fingerprint.value();
}

std::string encode(const Checkpoint& checkpoint, std::uint64_t job) {
  // A large one is as large as all else that the optimiser has: a text that grows would hold it twice.
  Counter counter;
  transfer(counter, checkpoint);
  Writer writer;
  writer.bytes.reserve(sizeof(Header) + counter.size);
  writer.bytes.resize(sizeof(Header));
  transfer(writer, checkpoint);
  Header header{};
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  header.version = kVersion;
  header.job = job;
  const std::string_view body = std::string_view(writer.bytes).substr(sizeof header);
  header.size = body.size();
  header.checksum = checksum(body);
  std::memcpy(writer.bytes.data(), &header, sizeof header);
  return std::move(writer.bytes);
}

Checkpoint decode(std::string_view blob, std::uint64_t job) {
  Header header;
  if (blob.size() < sizeof header)
    throw InvalidInput("the checkpoint has " + std::to_string(blob.size()) +
                       " bytes, which is less than its header of " + std::to_string(sizeof header) +
                       "; start again without it");
  std::memcpy(&header, blob.data(), sizeof header);
  const std::string_view body = blob.substr(sizeof header);
  if (std::memcmp(header.magic, kMagic, sizeof kMagic) != 0)
    throw InvalidInput("the checkpoint is not one that register_images made; start again without it");
  if (header.version != kVersion)
    throw InvalidInput("the checkpoint has version " + std::to_string(header.version) + " and this program reads " +
                       std::to_string(kVersion) + "; start again without it");
  if (header.size != body.size())
    throw InvalidInput("the checkpoint is cut off, it has " + std::to_string(body.size()) + " of " +
                       std::to_string(header.size) + " bytes; start again without it");
  if (header.checksum != checksum(body))
    throw InvalidInput("the checkpoint is damaged, its checksum does not match; start again without it");
  if (header.job != job)
    throw InvalidInput(
        "the checkpoint belongs to another registration; give the images and options that it was made with, or start "
        "again without it");
  Checkpoint checkpoint;
  Reader reader(body);
  transfer(reader, checkpoint);
  if (!reader.is_at_end())
    throw InvalidInput("the checkpoint is damaged, it holds more than it should; start again without it");
  return checkpoint;
}

template std::uint64_t job_fingerprint(const RegistrationInput<2>&, const RegistrationOptions&);
template std::uint64_t job_fingerprint(const RegistrationInput<3>&, const RegistrationOptions&);

}  // namespace saltus
