// Renders poses of an object in C++, and prints the mean grey value of each.
//
//     poses SCENE OBJECT [POSES]

#include "dunkelfeld.hpp"

#include <cstdio>
#include <cstdlib>
#include <numeric>
#include <string>

int main(int argc, char **argv) {
    if (argc < 3) {
        std::fprintf(stderr, "usage: %s SCENE OBJECT [POSES]\n", argv[0]);
        return 2;
    }
    try {
        dunkelfeld::check(dunkelfeld_check_abi(DUNKELFELD_ABI_VERSION));
        dunkelfeld::Scene scene(argv[1]);
        const int poses = argc > 3 ? std::atoi(argv[3]) : 4;
        dunkelfeld::RenderOptions options;
        options.keys = "budget.spp = 8";
        for (int pose = 0; pose < poses; ++pose) {
            const std::string degrees = std::to_string(360 * pose / poses);
            scene.set_overrides("[[object]]\nname = '" + std::string(argv[2]) + "'\npivot = 'center'\nrotate = [0, '" +
                                degrees + "deg', 0]\n");
            const auto frame = scene.render(options).expose().front();
            const double sum = std::accumulate(frame.data.begin(), frame.data.end(), 0.0);
            std::printf("%3s degrees: mean grey value %.2f\n", degrees.c_str(), sum / double(frame.data.size()));
        }
    } catch (const dunkelfeld::Error &error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        return 1;
    }
}
