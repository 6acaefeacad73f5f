#include <gmock/gmock.h>
#include <itkImageFileReader.h>
#include <itkImageFileWriter.h>
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>
#include <itkPNGImageIO.h>
#include <itkRGBPixel.h>
#include <sys/resource.h>
#include <zlib.h>

#include <atomic>
#include <csignal>
#include <fstream>
#include <numeric>
#include <random>
#include <thread>

#include "core/image_io/read_image.h"
#include "core/image_io/write_image.h"
#include "core/support/errors.h"
#include "tests/integration/image_io/sample_images.h"

namespace saltus {
namespace {

using testing::expect_same_place;
using testing::oblique_grid;
using testing::sample_vectors;
using testing::sample_volume;
using testing::TemporaryFolder;

itk::ImageIOBase::Pointer itk_io(const std::string& suffix) {
  if (suffix == ".mha") return itk::MetaImageIO::New().GetPointer();
  if (suffix == ".nrrd") return itk::NrrdImageIO::New().GetPointer();
  if (suffix == ".png") return itk::PNGImageIO::New().GetPointer();
  return itk::NiftiImageIO::New().GetPointer();
}

/// NIfTI stores origin and directions as floats; corners are up to 250 mm from 0, and an ulp of 250 is 1.5e-5.
double place_tolerance(const std::string& suffix) { return suffix.starts_with(".nii") ? 1e-4 : 1e-9; }

template <typename ItkImage>
typename ItkImage::Pointer read_with_itk(const std::filesystem::path& path, const std::string& suffix) {
  auto reader = itk::ImageFileReader<ItkImage>::New();
  reader->SetImageIO(itk_io(suffix));
  reader->SetFileName(path.string());
  reader->Update();
  return reader->GetOutput();
}

template <typename ItkImage>
void write_with_itk(const ItkImage* image, const std::filesystem::path& path, const std::string& suffix) {
  auto writer = itk::ImageFileWriter<ItkImage>::New();
  writer->SetImageIO(itk_io(suffix));
  writer->SetFileName(path.string());
  writer->SetInput(image);
  writer->Update();
}

template <typename ItkImage, int Dim>
typename ItkImage::Pointer make_itk_image(const ImageGrid<Dim>& grid) {
  auto image = ItkImage::New();
  typename ItkImage::SizeType size;
  typename ItkImage::SpacingType spacing;
  typename ItkImage::PointType origin;
  typename ItkImage::DirectionType direction;
  for (int axis = 0; axis < Dim; ++axis) {
    size[axis] = grid.size[axis];
    spacing[axis] = grid.spacing[axis];
    origin[axis] = grid.origin[axis];
    for (int row = 0; row < Dim; ++row) direction(row, axis) = grid.direction(row, axis);
  }
  image->SetRegions(size);
  image->SetSpacing(spacing);
  image->SetOrigin(origin);
  image->SetDirection(direction);
  image->Allocate();
  return image;
}

/// ITK's own idea of where voxels are against ours, at every voxel.
template <int Dim, typename ItkImage>
void expect_itk_agrees(const ItkImage& image, const ImageGrid<Dim>& grid, double tolerance_mm) {
  for (std::size_t i = 0; i < grid.voxels(); ++i) {
    const auto index = image.ComputeIndex(i);
    typename ItkImage::PointType point;
    image.TransformIndexToPhysicalPoint(index, point);
    Vector<Dim> ours;
    for (int axis = 0; axis < Dim; ++axis) ours[axis] = index[axis];
    ours = grid.to_world(ours);
    for (int axis = 0; axis < Dim; ++axis) ASSERT_NEAR(point[axis], ours[axis], tolerance_mm) << index;
  }
}

template <int Dim>
void scalar_round_trip(const std::string& suffix) {
  const TemporaryFolder folder;
  const auto path = folder / ("image" + suffix);
  const Volume<Dim> written = sample_volume<Dim>();
  write_volume(path, written);
  EXPECT_EQ(image_dimension(path), Dim);
  const Volume<Dim> read = read_volume<Dim>(path);
  EXPECT_EQ(read.samples, written.samples);
  expect_same_place(read.grid, written.grid, place_tolerance(suffix));
  EXPECT_EQ(read_grid<Dim>(path), read.grid);

  using ItkImage = itk::Image<float, Dim>;
  const auto oracle = read_with_itk<ItkImage>(path, suffix);
  ASSERT_EQ(oracle->GetLargestPossibleRegion().GetNumberOfPixels(), written.samples.size());
  expect_itk_agrees<Dim>(*oracle, read.grid, 1e-5);
  expect_itk_agrees<Dim>(*oracle, written.grid, place_tolerance(suffix));
  EXPECT_TRUE(std::equal(written.samples.begin(), written.samples.end(), oracle->GetBufferPointer()));
  // Nothing but the image is left behind.
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

template <int Dim>
void vector_round_trip(const std::string& suffix) {
  const TemporaryFolder folder;
  const auto path = folder / ("field" + suffix);
  const VectorVolume<Dim> written = sample_vectors<Dim>();
  write_vector_volume(path, written);
  EXPECT_EQ(image_dimension(path), Dim);
  const VectorVolume<Dim> read = read_vector_volume<Dim>(path);
  EXPECT_EQ(read.samples, written.samples);
  expect_same_place(read.grid, written.grid, place_tolerance(suffix));

  using ItkImage = itk::Image<itk::Vector<float, Dim>, Dim>;
  const auto oracle = read_with_itk<ItkImage>(path, suffix);
  ASSERT_EQ(oracle->GetLargestPossibleRegion().GetNumberOfPixels(), written.grid.voxels());
  expect_itk_agrees<Dim>(*oracle, written.grid, place_tolerance(suffix));
  for (std::size_t i = 0; i < written.grid.voxels(); ++i) {
    for (int c = 0; c < Dim; ++c) ASSERT_EQ(oracle->GetBufferPointer()[i][c], written.component(c)[i]);
  }
}

/// Files that ITK wrote, of another pixel type than float.
template <typename Pixel, int Dim>
void reads_what_itk_wrote(const std::string& suffix) {
  const TemporaryFolder folder;
  const auto path = folder / ("image" + suffix);
  const ImageGrid<Dim> grid = oblique_grid<Dim>();
  auto image = make_itk_image<itk::Image<Pixel, Dim>>(grid);
  std::iota(image->GetBufferPointer(), image->GetBufferPointer() + grid.voxels(), Pixel{3});
  write_with_itk(image.GetPointer(), path, suffix);
  const Volume<Dim> read = read_volume<Dim>(path);
  // MetaImage as ITK writes it by default has six digits: 5e-7 of up to 203 mm, and of direction times extent.
  expect_same_place(read.grid, grid, suffix == ".mha" ? 1e-3 : place_tolerance(suffix));
  for (std::size_t i = 0; i < grid.voxels(); ++i) ASSERT_EQ(read.samples[i], 3.0f + i);
}

class ImageFormats : public ::testing::TestWithParam<std::string> {};

TEST_P(ImageFormats, Scalar2dRoundTrip) { scalar_round_trip<2>(GetParam()); }
TEST_P(ImageFormats, Scalar3dRoundTrip) { scalar_round_trip<3>(GetParam()); }
TEST_P(ImageFormats, Vector2dRoundTrip) { vector_round_trip<2>(GetParam()); }
TEST_P(ImageFormats, Vector3dRoundTrip) { vector_round_trip<3>(GetParam()); }
TEST_P(ImageFormats, ReadsBytesOfItk) { reads_what_itk_wrote<unsigned char, 3>(GetParam()); }
TEST_P(ImageFormats, ReadsShortsOfItk) { reads_what_itk_wrote<short, 2>(GetParam()); }
TEST_P(ImageFormats, ReadsDoublesOfItk) { reads_what_itk_wrote<double, 3>(GetParam()); }

TEST_P(ImageFormats, OneSliceStaysThreeDimensional) {
  const TemporaryFolder folder;
  ImageGrid<3> grid = oblique_grid<3>();
  grid.size[2] = 1;
  const auto image_path = folder / ("image" + GetParam());
  const Volume<3> image = sample_volume(grid);
  write_volume(image_path, image);
  EXPECT_EQ(image_dimension(image_path), 3);
  EXPECT_EQ(read_volume<3>(image_path).samples, image.samples);
  expect_same_place(read_grid<3>(image_path), grid, place_tolerance(GetParam()));
  EXPECT_NEAR(read_grid<3>(image_path).spacing[2], grid.spacing[2], 1e-6);

  const auto field_path = folder / ("field" + GetParam());
  const VectorVolume<3> field = sample_vectors(grid);
  write_vector_volume(field_path, field);
  EXPECT_EQ(image_dimension(field_path), 3);
  EXPECT_EQ(read_vector_volume<3>(field_path).samples, field.samples);
  expect_same_place(read_grid<3>(field_path), grid, place_tolerance(GetParam()));
}

TEST_P(ImageFormats, LabelsAreBytes) {
  const TemporaryFolder folder;
  const auto path = folder / ("labels" + GetParam());
  Volume<3> labels(oblique_grid<3>());
  for (std::size_t i = 0; i < labels.samples.size(); ++i) labels.samples[i] = static_cast<float>((i * 37) % 256);
  write_labels(path, labels);
  EXPECT_EQ(read_volume<3>(path).samples, labels.samples);
  const auto io = itk_io(GetParam());
  io->SetFileName(path.string());
  io->ReadImageInformation();
  EXPECT_EQ(io->GetComponentType(), itk::IOComponentEnum::UCHAR);
}

TEST_P(ImageFormats, ReplacesAnOlderFileOfTheSameName) {
  const TemporaryFolder folder;
  const auto path = folder / ("image" + GetParam());
  write_volume(path, Volume<3>(oblique_grid<3>(), 1.0f));
  write_volume(path, sample_volume<2>());
  EXPECT_EQ(read_volume<2>(path).samples, sample_volume<2>().samples);
}

INSTANTIATE_TEST_SUITE_P(All, ImageFormats, ::testing::Values(".mha", ".nii", ".nii.gz", ".nrrd"),
                         [](const auto& info) {
                           std::string name = info.param.substr(1);
                           std::replace(name.begin(), name.end(), '.', '_');
                           return name;
                         });

std::string bytes_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Of the one gzip member that the file has to be, with nothing behind it.
std::string unpacked(const std::filesystem::path& path) {
  std::string packed = bytes_of(path), plain(1 << 24, '\0');
  z_stream stream{};
  constexpr int gzip = 15 + 16;
  if (inflateInit2(&stream, gzip) != Z_OK) throw std::bad_alloc();
  stream.next_in = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_in = static_cast<uInt>(packed.size());
  stream.next_out = reinterpret_cast<Bytef*>(plain.data());
  stream.avail_out = static_cast<uInt>(plain.size());
  EXPECT_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END) << path;
  EXPECT_EQ(stream.avail_in, 0u) << path;
  plain.resize(stream.total_out);
  inflateEnd(&stream);
  return plain;
}

template <int Dim>
void files_are_those_of_itk(const ImageGrid<Dim>& grid, const std::string& suffix) {
  const TemporaryFolder folder;
  const bool is_packed = suffix == ".nii.gz";
  const std::string plain = is_packed ? ".nii" : suffix;
  const auto of_itk = [&](const auto& image, const std::string& name) {
    auto writer = itk::ImageFileWriter<std::remove_reference_t<decltype(*image)>>::New();
    const auto io = itk_io(plain);
    if (plain == ".mha") static_cast<itk::MetaImageIO&>(*io).SetDoublePrecision(17);
    writer->SetImageIO(io);
    writer->SetFileName((folder / (name + plain)).string());
    writer->SetInput(image);
    writer->Update();
    return bytes_of(folder / (name + plain));
  };
  const auto ours = [&](const std::string& name) {
    return is_packed ? unpacked(folder / (name + suffix)) : bytes_of(folder / (name + suffix));
  };
  const Volume<Dim> image = sample_volume(grid);
  auto scalars = make_itk_image<itk::Image<float, Dim>>(grid);
  std::copy(image.samples.begin(), image.samples.end(), scalars->GetBufferPointer());
  write_volume(folder / ("image" + suffix), image);
  EXPECT_TRUE(ours("image") == of_itk(scalars.GetPointer(), "itk_image")) << suffix << " of scalars";

  const VectorVolume<Dim> field = sample_vectors(grid);
  auto vectors = make_itk_image<itk::Image<itk::Vector<float, Dim>, Dim>>(grid);
  for (std::size_t i = 0; i < grid.voxels(); ++i)
    for (int c = 0; c < Dim; ++c) vectors->GetBufferPointer()[i][c] = field.component(c)[i];
  write_vector_volume(folder / ("field" + suffix), field);
  EXPECT_TRUE(ours("field") == of_itk(vectors.GetPointer(), "itk_field")) << suffix << " of vectors";

  Volume<Dim> labels(grid, 3.0f);
  auto bytes = make_itk_image<itk::Image<unsigned char, Dim>>(grid);
  bytes->FillBuffer(3);
  write_labels(folder / ("labels" + suffix), labels);
  EXPECT_TRUE(ours("labels") == of_itk(bytes.GetPointer(), "itk_labels")) << suffix << " of labels";
}

TEST(ImagesOfItk, AreOursByteForByte) {
  for (const std::string suffix : {".mha", ".nrrd", ".nii", ".nii.gz"}) {
    files_are_those_of_itk(oblique_grid<2>(), suffix);
    files_are_those_of_itk(oblique_grid<3>(), suffix);
    for (int axis = 0; axis < 3; ++axis)
      for (const int size : {1, 2}) {
        ImageGrid<3> grid = oblique_grid<3>();
        grid.size[axis] = size;
        files_are_those_of_itk(grid, suffix);
      }
    // More than is put together at once.
    ImageGrid<3> large = oblique_grid<3>();
    large.size = {37, 31, 29};
    files_are_those_of_itk(large, suffix);
  }
}

TEST(WriteImage, TakesSuffixesInCapitals) {
  const TemporaryFolder folder;
  const Volume<3> image = sample_volume<3>();
  for (const char* name : {"image.MHA", "image.NRRD", "image.NII.GZ"}) {
    write_volume(folder / name, image);
    EXPECT_TRUE(std::filesystem::exists(folder / name)) << name;
  }
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 3) << "files were left behind";
}

TEST(NiftiImages, LargerThanWhatIsPackedAtOnceAreOneMember) {
  const TemporaryFolder folder;
  ImageGrid<3> grid = oblique_grid<3>();
  grid.size = {91, 83, 77};
  Volume<3> noise(grid);
  std::mt19937 bits(1);
  for (float& sample : noise.samples) sample = static_cast<float>(bits());
  write_volume(folder / "noise.nii.gz", noise);
  write_volume(folder / "noise.nii", noise);
  EXPECT_TRUE(unpacked(folder / "noise.nii.gz") == bytes_of(folder / "noise.nii"));
  EXPECT_EQ(read_volume<3>(folder / "noise.nii.gz").samples, noise.samples);
}

TEST(NiftiImages, LongerThanTheHeaderCanTellAreRefused) {
  const TemporaryFolder folder;
  ImageGrid<2> grid;
  grid.size = {2, 32768};
  for (const char* name : {"long.nii", "long.nii.gz"}) {
    try {
      write_volume(folder / name, Volume<2>(grid));
      ADD_FAILURE() << name;
    } catch (const InvalidInput& error) {
      EXPECT_THAT(error.what(), ::testing::HasSubstr("32768 voxels along an axis"));
      EXPECT_THAT(error.what(), ::testing::HasSubstr(name));
    }
    EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  }
}

TEST(PngImages, GreyRangeIsMappedToEightBits) {
  const TemporaryFolder folder;
  ImageGrid<2> grid;
  grid.size = {4, 2};
  Volume<2> image(grid);
  image.samples = {-5, 0, 25, 50, 75, 100, 300, 12.5f};
  write_volume(folder / "a.png", image, GreyRange{0, 100});
  EXPECT_THAT(read_volume<2>(folder / "a.png").samples, ::testing::ElementsAre(0, 0, 64, 128, 191, 255, 255, 32));
  write_volume(folder / "b.png", image);  // -5..300
  const auto read = read_volume<2>(folder / "b.png");
  EXPECT_EQ(read.samples[0], 0);
  EXPECT_EQ(read.samples[6], 255);
  EXPECT_EQ(read.samples[5], std::round(105.0f * 255 / 305));
  EXPECT_EQ(read.grid, grid);
  write_volume(folder / "constant.png", Volume<2>(grid, 7.0f));
  EXPECT_THAT(read_volume<2>(folder / "constant.png").samples, ::testing::Each(0));
}

TEST(PngImages, LabelsAreNotScaled) {
  const TemporaryFolder folder;
  ImageGrid<2> grid;
  grid.size = {3, 1};
  Volume<2> labels(grid);
  labels.samples = {0, 1, 200};
  write_labels(folder / "a.png", labels);
  EXPECT_EQ(read_volume<2>(folder / "a.png").samples, labels.samples);
}

TEST(PngImages, SixteenBitsAreKept) {
  const TemporaryFolder folder;
  ImageGrid<2> grid;
  grid.size = {3, 2};
  auto image = make_itk_image<itk::Image<unsigned short, 2>>(grid);
  std::iota(image->GetBufferPointer(), image->GetBufferPointer() + 6, 65000);
  write_with_itk(image.GetPointer(), folder / "deep.png", ".png");
  EXPECT_THAT(read_volume<2>(folder / "deep.png").samples,
              ::testing::ElementsAre(65000, 65001, 65002, 65003, 65004, 65005));
}

TEST(PngImages, ColourBecomesLuminance) {
  const TemporaryFolder folder;
  ImageGrid<2> grid;
  grid.size = {4, 1};
  using Colour = itk::RGBPixel<unsigned char>;
  auto image = make_itk_image<itk::Image<Colour, 2>>(grid);
  const unsigned char colours[4][3] = {{255, 0, 0}, {0, 255, 0}, {0, 0, 255}, {77, 77, 77}};
  for (int i = 0; i < 4; ++i) image->GetBufferPointer()[i] = Colour(colours[i]);
  write_with_itk(image.GetPointer(), folder / "colour.png", ".png");
  EXPECT_EQ(image_dimension(folder / "colour.png"), 2);
  // Rec. 709 weights.
  EXPECT_THAT(read_volume<2>(folder / "colour.png").samples,
              ::testing::Pointwise(::testing::FloatNear(1e-4), {54.1875f, 182.427f, 18.3855f, 77.0f}));
}

TEST(WriteImage, RefusesWhatTheFormatCannotHold) {
  const TemporaryFolder folder;
  EXPECT_THROW(write_volume(folder / "a.png", sample_volume<3>()), InvalidInput);
  EXPECT_THROW(write_vector_volume(folder / "a.png", sample_vectors<2>()), InvalidInput);
  EXPECT_THROW(write_volume(folder / "a.dcm", sample_volume<3>()), InvalidInput);
  EXPECT_THROW(write_labels(folder / "a.mha", sample_volume<3>()), InvalidInput);
  Volume<3> short_volume = sample_volume<3>();
  short_volume.samples.pop_back();
  EXPECT_THROW(write_volume(folder / "a.mha", short_volume), InvalidInput);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  EXPECT_THROW(write_volume(folder / "nowhere/a.mha", sample_volume<3>()), FileError);
}

/// Writes where no file may grow beyond `most` bytes, which stands for the full disk, and ends the process with 0 when
/// that was an error that names the file, and left nothing.
[[noreturn]] void write_on_full_disk(const std::filesystem::path& path, rlim_t most) {
  signal(SIGXFSZ, SIG_IGN);
  const rlimit limit{most, most};
  setrlimit(RLIMIT_FSIZE, &limit);
  ImageGrid<3> grid;
  grid.size = {40, 40, 40};
  try {
    write_volume(path, sample_volume(grid));
    _exit(1);
  } catch (const FileError& error) {
    const bool is_clean = std::filesystem::is_empty(path.parent_path());
    std::filesystem::remove_all(path.parent_path());  // Ours: a test that starts itself anew makes its own folder.
    const std::string text = error.what(), begin = "cannot write " + path.filename().string() + ": ";
    const bool is_named = text.starts_with(begin) && text.find("." + std::to_string(getpid())) == std::string::npos;
    _exit(!is_clean ? 2 : !is_named ? 3 : 0);
  }
}

TEST_P(ImageFormats, FullDiskIsAnErrorAndLeavesNothing) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");  // ITK has threads, which a bare fork would lose.
  const TemporaryFolder folder;
  for (rlim_t most : {0, 100, 512})
    EXPECT_EXIT(write_on_full_disk(folder / ("image" + GetParam()), most), ::testing::ExitedWithCode(0), "") << most;
}

TEST_P(ImageFormats, AFolderThatTakesNoFilesIsAnErrorThatNamesTheFile) {
  const std::filesystem::path path = "/proc/self/image" + GetParam();
  try {
    write_volume(path, sample_volume<3>());
    ADD_FAILURE() << "written";
  } catch (const FileError& error) {
    EXPECT_THAT(error.what(), ::testing::StartsWith("cannot write image" + GetParam() + ": "));
  }
}

/// As above, by eight threads at once.
[[noreturn]] void write_many_on_full_disk(const std::filesystem::path& folder, const std::string& suffix) {
  signal(SIGXFSZ, SIG_IGN);
  const rlimit limit{400, 400};
  setrlimit(RLIMIT_FSIZE, &limit);
  std::atomic<int> refused = 0;
  std::vector<std::thread> threads;
  constexpr int count = 8, each = 20;
  for (int t = 0; t < count; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < each; ++i) try {
          write_vector_volume(folder / ("field" + std::to_string(t) + suffix), sample_vectors<3>());
        } catch (const FileError&) {
          ++refused;
        }
    });
  for (std::thread& thread : threads) thread.join();
  const bool is_clean = std::filesystem::is_empty(folder);
  std::filesystem::remove_all(folder);
  _exit(refused == count * each && is_clean ? 0 : 2);
}

TEST_P(ImageFormats, SeveralThreadsAreAllToldOfAFullDisk) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const TemporaryFolder folder;
  EXPECT_EXIT(write_many_on_full_disk(folder.path(), GetParam()), ::testing::ExitedWithCode(0), "");
}

TEST_P(ImageFormats, SeveralThreadsWriteAtOnce) {
  const TemporaryFolder folder;
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < 5; ++i)
        write_vector_volume(folder / ("field" + std::to_string(t) + GetParam()), sample_vectors<3>());
    });
  for (std::thread& thread : threads) thread.join();
  for (int t = 0; t < 8; ++t)
    EXPECT_EQ(read_vector_volume<3>(folder / ("field" + std::to_string(t) + GetParam())).samples,
              sample_vectors<3>().samples);
}

}  // namespace
}  // namespace saltus
