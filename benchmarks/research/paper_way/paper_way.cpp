// A point cloud to geodesic fields as the paper does it (Section III): moving least squares, greedy projection
// triangulation, a graph of the triangles' edges, Dijkstra's shortest paths. One thread.
//
// paper_way CLOUD MESH SEARCH_RADIUS_M
//   CLOUD  int32 points, int32 sources, float32 x y z of each point in metres, int32 point number of each source
//   MESH   written: int32 nodes, int32 triangles, int32 sources, float32 x y z of each node, int32 corners of each
//          triangle, int32 node of each source, float32 distance of each node from each source (infinite: no path)
// Prints the milliseconds of each step as JSON. Parameters are those of PCL's tutorials "Smoothing and normal estimation
// based on polynomial reconstruction" (radius 0.03 m) and "Fast triangulation of unordered point clouds" (mu 2.5, 100
// neighbours, 45 degrees, 10 to 120 degrees; radius 0.025 m), with SEARCH_RADIUS_M for the latter.

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <vector>

#include <boost/graph/adjacency_list.hpp>
#include <boost/graph/dijkstra_shortest_paths.hpp>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/surface/gp3.h>
#include <pcl/surface/mls.h>

namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using Smooth = pcl::PointCloud<pcl::PointNormal>;
using Graph = boost::adjacency_list<boost::vecS, boost::vecS, boost::undirectedS, boost::no_property,
                                    boost::property<boost::edge_weight_t, float>>;

struct Input {
  Cloud::Ptr cloud;
  std::vector<std::int32_t> sources;
};

Input read_input(const char* path) {
  std::ifstream file(path, std::ios::binary);
  std::int32_t points = 0, sources = 0;
  file.read(reinterpret_cast<char*>(&points), 4).read(reinterpret_cast<char*>(&sources), 4);
  Input input{Cloud::Ptr(new Cloud), std::vector<std::int32_t>(sources)};
  for (std::int32_t k = 0; k < points; ++k) {
    float xyz[3];
    file.read(reinterpret_cast<char*>(xyz), 12);
    input.cloud->push_back(pcl::PointXYZ(xyz[0], xyz[1], xyz[2]));
  }
  file.read(reinterpret_cast<char*>(input.sources.data()), 4 * sources);
  if (!file) throw std::runtime_error("the point cloud ends early");
  return input;
}

Smooth::Ptr smooth(const Cloud::Ptr& cloud) {
  Smooth::Ptr result(new Smooth);
  pcl::MovingLeastSquares<pcl::PointXYZ, pcl::PointNormal> mls;
  mls.setComputeNormals(true);
  mls.setInputCloud(cloud);
  mls.setPolynomialOrder(2);
  mls.setSearchMethod(pcl::search::KdTree<pcl::PointXYZ>::Ptr(new pcl::search::KdTree<pcl::PointXYZ>));
  mls.setSearchRadius(0.03);
  mls.setNumberOfThreads(1);
  mls.process(*result);
  return result;
}

std::vector<pcl::Vertices> triangulate(const Smooth::Ptr& cloud, double radius) {
  std::vector<pcl::Vertices> triangles;
  pcl::search::KdTree<pcl::PointNormal>::Ptr tree(new pcl::search::KdTree<pcl::PointNormal>);
  tree->setInputCloud(cloud);
  pcl::GreedyProjectionTriangulation<pcl::PointNormal> gp3;
  gp3.setSearchRadius(radius);
  gp3.setMu(2.5);
  gp3.setMaximumNearestNeighbors(100);
  gp3.setMaximumSurfaceAngle(M_PI / 4);
  gp3.setMinimumAngle(M_PI / 18);
  gp3.setMaximumAngle(2 * M_PI / 3);
  gp3.setNormalConsistency(false);
  gp3.setInputCloud(cloud);
  gp3.setSearchMethod(tree);
  gp3.reconstruct(triangles);
  return triangles;
}

Graph connect(const Smooth& cloud, const std::vector<pcl::Vertices>& triangles) {
  Graph graph(cloud.size());
  for (const auto& triangle : triangles)
    for (int side = 0; side < 3; ++side) {
      const auto a = triangle.vertices[side], b = triangle.vertices[(side + 1) % 3];
      const float length = (cloud[a].getVector3fMap() - cloud[b].getVector3fMap()).norm();
      boost::add_edge(a, b, length, graph);
    }
  return graph;
}

std::vector<float> shortest_paths(const Graph& graph, std::int32_t source) {
  std::vector<float> distance(boost::num_vertices(graph));
  boost::dijkstra_shortest_paths(
      graph, source,
      boost::distance_map(boost::make_iterator_property_map(distance.begin(), boost::get(boost::vertex_index, graph)))
          .distance_inf(std::numeric_limits<float>::infinity()));
  return distance;
}

void write_mesh(const char* path, const Smooth& cloud, const std::vector<pcl::Vertices>& triangles,
                const std::vector<std::int32_t>& sources, const std::vector<std::vector<float>>& fields) {
  std::ofstream file(path, std::ios::binary);
  const std::int32_t counts[3] = {std::int32_t(cloud.size()), std::int32_t(triangles.size()), std::int32_t(sources.size())};
  file.write(reinterpret_cast<const char*>(counts), 12);
  for (const auto& point : cloud) file.write(reinterpret_cast<const char*>(point.data), 12);
  for (const auto& triangle : triangles)
    for (const std::int32_t corner : triangle.vertices) file.write(reinterpret_cast<const char*>(&corner), 4);
  file.write(reinterpret_cast<const char*>(sources.data()), 4 * sources.size());
  for (const auto& field : fields) file.write(reinterpret_cast<const char*>(field.data()), 4 * field.size());
}

class Stopwatch {
 public:
  double lap_ms() {
    const auto now = std::chrono::steady_clock::now();
    const double passed = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return passed;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace

int main(int count, char** arguments) {
  if (count != 4) {
    std::fprintf(stderr, "paper_way CLOUD MESH SEARCH_RADIUS_M\n");
    return 2;
  }
  const Input input = read_input(arguments[1]);
  smooth(input.cloud);  // once unmeasured: the program's pages and the processor's caches
  Stopwatch watch;
  const Smooth::Ptr smoothed = smooth(input.cloud);
  const double smooth_ms = watch.lap_ms();
  const std::vector<pcl::Vertices> triangles = triangulate(smoothed, std::atof(arguments[3]));
  const double mesh_ms = watch.lap_ms();
  const Graph graph = connect(*smoothed, triangles);
  const double graph_ms = watch.lap_ms();
  std::vector<std::vector<float>> fields;
  for (const std::int32_t source : input.sources) fields.push_back(shortest_paths(graph, source));
  const double dijkstra_ms = watch.lap_ms();
  if (smoothed->size() != input.cloud->size()) throw std::runtime_error("moving least squares lost points");
  write_mesh(arguments[2], *smoothed, triangles, input.sources, fields);
  std::printf("{\"smoothing\": %.3f, \"triangulation\": %.3f, \"graph\": %.3f, \"dijkstra\": %.3f}\n", smooth_ms, mesh_ms,
              graph_ms, dijkstra_ms);
}
