// The local descriptors of the Point Cloud Library, one thread: reference numbers, and how long they take.
//
// pcl_features CLOUD RADIUS_M DESCRIPTOR RUNS OUT
//   CLOUD       int32 points, int32 triangles, int32 chosen, float32 x y z of each point in metres, float32 normal of
//               each point, int32 corners of each triangle, int32 number of each point to describe
//   DESCRIPTOR  fpfh (33 numbers), frame (9, SHOT's x y z axes), shot (352), turn (9, the axes that the shape context
//               draws at random, x y z), context (1980), unique (1960, unique shape context), rops (135)
//   OUT         written: float32, a row for each chosen point
// Prints the milliseconds of each run as JSON, the search tree and the local frames included. Radii inside the shape
// contexts are a tenth (innermost shell) and a fifth (density) of RADIUS_M.

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include <pcl/features/3dsc.h>
#include <pcl/features/fpfh.h>
#include <pcl/features/rops_estimation.h>
#include <pcl/features/shot.h>
#include <pcl/features/shot_lrf.h>
#include <pcl/features/usc.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#ifdef PCL_NO_PRECOMPILE
#include <pcl/features/impl/3dsc.hpp>
#include <pcl/features/impl/fpfh.hpp>
#include <pcl/features/impl/rops_estimation.hpp>
#include <pcl/features/impl/shot.hpp>
#include <pcl/features/impl/shot_lrf.hpp>
#include <pcl/features/impl/usc.hpp>
#endif

namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using Normals = pcl::PointCloud<pcl::Normal>;
using Tree = pcl::search::KdTree<pcl::PointXYZ>;
using Rows = std::vector<float>;

struct Input {
  Cloud::Ptr cloud{new Cloud};
  Normals::Ptr normals{new Normals};
  std::vector<pcl::Vertices> triangles;
  pcl::IndicesPtr chosen{new pcl::Indices};
};

template <typename Number>
std::vector<Number> read_numbers(std::ifstream& file, std::size_t count) {
  std::vector<Number> numbers(count);
  file.read(reinterpret_cast<char*>(numbers.data()), std::streamsize(count * sizeof(Number)));
  if (!file) throw std::runtime_error("the cloud ends early");
  return numbers;
}

Input read_input(const char* path) {
  std::ifstream file(path, std::ios::binary);
  const auto counts = read_numbers<std::int32_t>(file, 3);
  const auto place = read_numbers<float>(file, 3 * counts[0]), normal = read_numbers<float>(file, 3 * counts[0]);
  const auto corners = read_numbers<std::int32_t>(file, 3 * counts[1]);
  const auto chosen = read_numbers<std::int32_t>(file, counts[2]);
  Input input;
  for (std::int32_t k = 0; k < counts[0]; ++k) {
    input.cloud->push_back(pcl::PointXYZ(place[3 * k], place[3 * k + 1], place[3 * k + 2]));
    input.normals->push_back(pcl::Normal(normal[3 * k], normal[3 * k + 1], normal[3 * k + 2]));
  }
  for (std::int32_t t = 0; t < counts[1]; ++t) {
    pcl::Vertices triangle;
    for (int corner = 0; corner < 3; ++corner) triangle.vertices.push_back(corners[3 * t + corner]);
    input.triangles.push_back(triangle);
  }
  input.chosen->assign(chosen.begin(), chosen.end());
  return input;
}

template <typename Estimation>
void prepare(Estimation& estimation, const Input& input, double radius) {
  estimation.setInputCloud(input.cloud);
  estimation.setIndices(input.chosen);
  estimation.setSearchMethod(Tree::Ptr(new Tree));
  estimation.setRadiusSearch(radius);
}

template <typename Estimation>
void set_cells(Estimation& estimation, double radius) {
  estimation.setMinimalRadius(radius / 10);
  estimation.setPointDensityRadius(radius / 5);
}

Rows fpfh(const Input& input, double radius) {
  pcl::FPFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::FPFHSignature33> estimation;
  prepare(estimation, input, radius);
  estimation.setInputNormals(input.normals);
  pcl::PointCloud<pcl::FPFHSignature33> found;
  estimation.compute(found);
  Rows rows;
  for (const auto& one : found) rows.insert(rows.end(), one.histogram, one.histogram + 33);
  return rows;
}

Rows frame(const Input& input, double radius) {
  pcl::SHOTLocalReferenceFrameEstimation<pcl::PointXYZ, pcl::ReferenceFrame> estimation;
  prepare(estimation, input, radius);
  pcl::PointCloud<pcl::ReferenceFrame> found;
  estimation.compute(found);
  Rows rows;
  for (const auto& one : found)
    for (const float* axis : {one.x_axis, one.y_axis, one.z_axis}) rows.insert(rows.end(), axis, axis + 3);
  return rows;
}

Rows shot(const Input& input, double radius) {
  pcl::SHOTEstimation<pcl::PointXYZ, pcl::Normal, pcl::SHOT352, pcl::ReferenceFrame> estimation;
  prepare(estimation, input, radius);
  estimation.setInputNormals(input.normals);
  pcl::PointCloud<pcl::SHOT352> found;
  estimation.compute(found);
  Rows rows;
  for (const auto& one : found) rows.insert(rows.end(), one.descriptor, one.descriptor + 352);
  return rows;
}

// The shape context does not tell its axes: each x is three numbers of a generator with a fixed seed, of which one is
// changed so that x lies in the tangent plane.
Rows turn(const Input& input, double) {
  std::mt19937 generator(12345u);
  std::uniform_real_distribution<float> between(0.0f, 1.0f);
  Rows rows;
  for (const auto number : *input.chosen) {
    const Eigen::Vector3f z = (*input.normals)[number].getNormalVector3fMap();
    Eigen::Vector3f x;
    for (int k = 0; k < 3; ++k) x[k] = between(generator);
    const int changed = z[2] != 0.0f ? 2 : z[1] != 0.0f ? 1 : 0;
    x[changed] = 0.0f;
    x[changed] = -z.dot(x) / z[changed];
    x.normalize();
    const Eigen::Vector3f y = z.cross(x);
    for (const auto& axis : {x, y, z}) rows.insert(rows.end(), axis.data(), axis.data() + 3);
  }
  return rows;
}

Rows context(const Input& input, double radius) {
  pcl::ShapeContext3DEstimation<pcl::PointXYZ, pcl::Normal, pcl::ShapeContext1980> estimation;
  prepare(estimation, input, radius);
  estimation.setInputNormals(input.normals);
  set_cells(estimation, radius);
  pcl::PointCloud<pcl::ShapeContext1980> found;
  estimation.compute(found);
  Rows rows;
  for (const auto& one : found) rows.insert(rows.end(), one.descriptor, one.descriptor + 1980);
  return rows;
}

Rows unique(const Input& input, double radius) {
  pcl::UniqueShapeContext<pcl::PointXYZ, pcl::UniqueShapeContext1960, pcl::ReferenceFrame> estimation;
  prepare(estimation, input, radius);
  estimation.setLocalRadius(radius);
  set_cells(estimation, radius);
  pcl::PointCloud<pcl::UniqueShapeContext1960> found;
  estimation.compute(found);
  Rows rows;
  for (const auto& one : found) rows.insert(rows.end(), one.descriptor, one.descriptor + 1960);
  return rows;
}

Rows rops(const Input& input, double radius) {
  pcl::ROPSEstimation<pcl::PointXYZ, pcl::Histogram<135>> estimation;
  prepare(estimation, input, radius);
  estimation.setSearchSurface(input.cloud);
  estimation.setTriangles(input.triangles);
  estimation.setSupportRadius(float(radius));
  pcl::PointCloud<pcl::Histogram<135>> found;
  estimation.compute(found);
  Rows rows;
  for (const auto& one : found.points) rows.insert(rows.end(), one.histogram, one.histogram + 135);
  return rows;
}

std::function<Rows(const Input&, double)> descriptor(const std::string& name) {
  if (name == "fpfh") return fpfh;
  if (name == "frame") return frame;
  if (name == "shot") return shot;
  if (name == "turn") return turn;
  if (name == "context") return context;
  if (name == "unique") return unique;
  if (name == "rops") return rops;
  throw std::runtime_error("no descriptor " + name);
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 6) {
    std::fprintf(stderr, "pcl_features CLOUD RADIUS_M DESCRIPTOR RUNS OUT\n");
    return 2;
  }
  try {
    const Input input = read_input(arguments[1]);
    const double radius = std::atof(arguments[2]);
    const auto describe = descriptor(arguments[3]);
    Rows rows;
    std::printf("[");
    for (int run = 0; run < std::atoi(arguments[4]); ++run) {
      const auto begin = std::chrono::steady_clock::now();
      rows = describe(input, radius);
      const std::chrono::duration<double, std::milli> passed = std::chrono::steady_clock::now() - begin;
      std::printf("%s%.4f", run ? ", " : "", passed.count());
    }
    std::printf("]\n");
    std::ofstream file(arguments[5], std::ios::binary);
    file.write(reinterpret_cast<const char*>(rows.data()), std::streamsize(rows.size() * sizeof(float)));
    if (!file) throw std::runtime_error("cannot write the rows");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
