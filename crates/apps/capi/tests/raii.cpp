// The header for C++: exceptions, an early end, threads, and files.

#include "dunkelfeld.hpp"

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <thread>

#define CHECK(truth)                                                                                                           \
    do {                                                                                                                       \
        if (!(truth)) {                                                                                                        \
            std::fprintf(stderr, "line %d: %s\n", __LINE__, #truth);                                                           \
            std::exit(1);                                                                                                      \
        }                                                                                                                      \
    } while (0)

template <class Exception, class Work> Exception thrown(Work work) {
    try {
        work();
    } catch (const Exception &exception) {
        return exception;
    }
    std::fprintf(stderr, "nothing was thrown\n");
    std::exit(1);
}

std::string content(const char *file) {
    std::ifstream stream(file, std::ios::binary);
    CHECK(stream.is_open());
    return std::string(std::istreambuf_iterator<char>(stream), {});
}

int main(int, char **argv) {
    const auto missing = thrown<dunkelfeld::Error>([] { dunkelfeld::Scene scene("there-is-no-such-file.glb"); });
    CHECK(missing.status() == DUNKELFELD_STATUS_INPUT && missing.file() == "there-is-no-such-file.glb" && !missing.help().empty());

    dunkelfeld::Scene scene(argv[1]);
    CHECK(scene.inspect().find("floor") != std::string::npos);
    dunkelfeld::RenderOptions options;
    options.keys = "seed = 7";
    const dunkelfeld::Film film = scene.render(options);
    const auto mean = film.mean();
    CHECK(mean.width == 24 && mean.height == 16 && mean.channels == 3 && mean.data.size() == 24 * 16 * 3);
    CHECK(scene.render(options).mean().data == mean.data);
    CHECK(film.spp().at(3, 4) == 4 && film.object_name(film.object_ids().at(12, 8)) == "part");
    CHECK(film.material_ids().at(12, 8) != DUNKELFELD_NO_ID && !film.material_name(film.material_ids().at(12, 8)).empty());
    CHECK(film.depth().at(12, 8) > 0.2f && film.normal().channels == 3 && film.albedo().data.size() == mean.data.size());
    CHECK(film.variance().at(0, 0) >= 0.0f && film.denoise("builtin").data.size() == mean.data.size());
    thrown<std::out_of_range>([&] { mean.at(24, 0); });

    // Two sensors and two frames of one film.
    const auto frames = film.expose("", 2);
    CHECK(frames.size() == 2 && frames[0].data != frames[1].data);
    CHECK(film.expose("sensor.model = 'imx174'")[0].data != frames[0].data && film.picture().channels == 1);
    CHECK(film.certificate(0.5).k == 0.5 && film.stats().find("samples") != std::string::npos);

    film.save("copy.film");
    CHECK(dunkelfeld::Film::load("copy.film").mean().data == mean.data);

    // Files: those of a film from a file are the same.
    film.save_files({"a.png", "a.tif", "a.exr", "a.json", "plan.exr"});
    dunkelfeld::Files files;
    files.exr = "b.exr";
    files.linear = "b.tif";
    dunkelfeld::Film::load("copy.film").save_files(files);
    CHECK(content("a.exr") == content("b.exr") && content("a.tif") == content("b.tif"));
    CHECK(content("a.json") == film.stats() && content("plan.exr").size() < content("a.exr").size());
    CHECK(thrown<dunkelfeld::Error>([&] { film.save_files({}); }).status() == DUNKELFELD_STATUS_SETTING);
    scene.set_overrides("[[object]]\nname = 'part'\nvisible = false\n");
    CHECK(scene.render(options).mean().data != mean.data);
    scene.set_overrides("");
    CHECK(scene.render(options).mean().data == mean.data);

    // A progress function that ends the render once each pixel has samples, and one that throws.
    options.keys = "budget.time = 60";
    options.progress = [](const DunkelfeldProgress &progress) { return progress.samples < 10 * 24 * 16; };
    const auto interrupted = thrown<dunkelfeld::Interrupted>([&] { scene.render(options); });
    CHECK(interrupted.film.spp().at(0, 0) > 0);
    options.progress = [](const DunkelfeldProgress &) -> bool { throw std::runtime_error("no more"); };
    CHECK(std::string(thrown<std::runtime_error>([&] { scene.render(options); }).what()) == "no more");

    // Another thread cancels.
    dunkelfeld::Cancel cancel;
    options.progress = nullptr;
    options.cancel = &cancel;
    std::thread other([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(200));
        cancel.cancel();
    });
    thrown<dunkelfeld::Interrupted>([&] { scene.render(options); });
    other.join();

    // Keys out of range, and texts with a zero byte.
    dunkelfeld::RenderOptions zero;
    zero.keys = "budget.spp = 0";
    CHECK(thrown<dunkelfeld::Error>([&] { scene.render(zero); }).status() == DUNKELFELD_STATUS_INPUT);
    zero.keys.clear();
    zero.camera = std::string("a\0b", 3);
    thrown<std::invalid_argument>([&] { scene.render(zero); });

    // Parts of a render, merged: the film of one render.
    dunkelfeld::RenderOptions part;
    part.keys = "seed = 7\nallocate.strategy = 'uniform'";
    for (const std::uint32_t from : {0u, 2u}) {
        part.samples = {from, from + 2};
        part.checkpoint = "part-" + std::to_string(from);
        CHECK(scene.render(part).spp().at(0, 0) == 2);
    }
    CHECK(dunkelfeld::merge({"part-0", "part-2"}).mean().data == mean.data);
    thrown<dunkelfeld::Error>([] { dunkelfeld::merge({}); });
    CHECK(dunkelfeld::sensors().find("imx250") != std::string::npos);
    std::puts("all checks hold");
}
