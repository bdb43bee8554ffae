// Renders a scene many times from one load, as `examples/renders.rs`:
//
//     c++ -O2 -std=c++17 benches/linking/renders.cpp $(pkg-config --cflags --libs dunkelfeld) -o renders
//     ./renders SCENE RENDERS SIDE SPP

#include <dunkelfeld.hpp>

#include <chrono>
#include <cstdio>
#include <cstdlib>

int main(int argc, char **argv) {
    if (argc != 5) return std::fprintf(stderr, "usage: %s SCENE RENDERS SIDE SPP\n", argv[0]), 2;
    dunkelfeld::Scene scene(argv[1]);
    dunkelfeld::RenderOptions options;
    options.width = options.height = std::uint32_t(std::atoi(argv[3]));
    options.spp = std::atof(argv[4]);
    for (int round = 1; round <= 3; ++round) {
        const auto began = std::chrono::steady_clock::now();
        double sum = 0.0;
        for (int seed = 0; seed < std::atoi(argv[2]); ++seed) {
            options.seed = std::uint64_t(seed);
            sum += double(scene.render(options).mean().at(0, 0));
        }
        const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - began;
        std::printf("round %d: %.4f s, sum %.6f\n", round, seconds.count(), sum);
    }
}
