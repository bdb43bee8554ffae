/*
 * Dunkelfeld for C++17: scenes and films that close themselves, vectors, and exceptions, above the interface of C.
 *
 * The names of settings are those of `dunkelfeld.h`, of Python and of job files. Buffers are row-major with row 0 at the top.
 * Every function may throw dunkelfeld::Error, and std::bad_alloc for its own vectors.
 */

#ifndef DUNKELFELD_HPP
#define DUNKELFELD_HPP

#include "dunkelfeld.h"

#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace dunkelfeld {

/** An error of the library. */
class Error : public std::runtime_error {
public:
    /** The error of the last call of this thread. */
    explicit Error(DunkelfeldStatus status)
        : std::runtime_error(part(DUNKELFELD_ERROR_PART_MESSAGE)), status_(status), file_(part(DUNKELFELD_ERROR_PART_FILE)),
          place_(part(DUNKELFELD_ERROR_PART_PLACE)), problem_(part(DUNKELFELD_ERROR_PART_PROBLEM)),
          help_(part(DUNKELFELD_ERROR_PART_HELP)) {}

    DunkelfeldStatus status() const noexcept { return status_; }
    const std::string &file() const noexcept { return file_; }
    const std::string &place() const noexcept { return place_; }
    const std::string &problem() const noexcept { return problem_; }
    const std::string &help() const noexcept { return help_; }

private:
    static std::string part(DunkelfeldErrorPart part) {
        const char *text = dunkelfeld_last_error(part);
        return text ? text : "";
    }

    DunkelfeldStatus status_;
    std::string file_, place_, problem_, help_;
};

/** Throws the error of a status. */
inline void check(DunkelfeldStatus status) {
    if (status != DUNKELFELD_STATUS_OK) throw Error(status);
}

namespace detail {

/** Takes a text of the library. */
inline std::string take(char *text) {
    const std::unique_ptr<char, void (*)(char *)> owned(text, dunkelfeld_text_close);
    return owned ? std::string(owned.get()) : std::string();
}

inline const char *text(const std::optional<std::string> &value) {
    if (value && value->find('\0') != std::string::npos) throw std::invalid_argument("dunkelfeld: a text has a zero byte");
    return value ? value->c_str() : nullptr;
}

/** Zero stands for a value that is not set. A zero that is set becomes one that the library refuses. */
inline double number(const std::optional<double> &value) {
    return !value ? 0.0 : *value == 0.0 ? std::numeric_limits<double>::quiet_NaN() : *value;
}

struct CloseScene {
    void operator()(DunkelfeldScene *scene) const noexcept { dunkelfeld_scene_close(scene); }
};
struct CloseFilm {
    void operator()(DunkelfeldFilm *film) const noexcept { dunkelfeld_film_close(film); }
};
struct CloseCancel {
    void operator()(DunkelfeldCancel *cancel) const noexcept { dunkelfeld_cancel_close(cancel); }
};

} // namespace detail

/** Pixels of one image: data[(y * width + x) * channels + c]. */
template <class T> struct Image {
    std::uint32_t width = 0, height = 0, channels = 1;
    std::vector<T> data;

    const T &at(std::uint32_t x, std::uint32_t y, std::uint32_t c = 0) const {
        if (x >= width || y >= height || c >= channels) throw std::out_of_range("dunkelfeld::Image::at");
        return data[(std::size_t(y) * width + x) * channels + c];
    }
};

/** A switch that cancels renders, from any thread. */
class Cancel {
public:
    Cancel() {
        DunkelfeldCancel *handle = nullptr;
        check(dunkelfeld_cancel_new(&handle));
        handle_.reset(handle);
    }

    void cancel() { check(dunkelfeld_cancel(handle_.get())); }
    DunkelfeldCancel *get() const noexcept { return handle_.get(); }

private:
    std::unique_ptr<DunkelfeldCancel, detail::CloseCancel> handle_;
};

/** Options of one render; what they leave out is that of the scene. */
struct RenderOptions {
    /** Keys of a job that do not change the scene, as lines of TOML: "budget.spp = 64". */
    std::string keys;
    std::optional<std::string> camera, checkpoint;
    std::optional<std::uint32_t> threads;
    /** First sample and end of the samples of a part, which merge() joins with others. */
    std::optional<std::pair<std::uint32_t, std::uint32_t>> samples;
    /** Is called about ten times a second. The value `false` cancels the render; an exception cancels it and is thrown on. */
    std::function<bool(const DunkelfeldProgress &)> progress;
    const Cancel *cancel = nullptr;
};

/** Files of a film; those without a path are not written. */
struct Files {
    /** PNG, 8 bit, gamma 2.2; 16-bit grey values, .png or .tif; EXR with all layers; JSON; EXR with the samples per pixel. */
    std::optional<std::string> image, linear, exr, stats, plan;
};

/** A rendered film. Copies share it. */
class Film {
public:
    /** Takes over a handle of the interface of C. */
    explicit Film(DunkelfeldFilm *handle) : handle_(handle, detail::CloseFilm()) {}

    static Film load(const std::string &path) {
        DunkelfeldFilm *film = nullptr;
        check(dunkelfeld_film_load(path.c_str(), &film));
        return Film(film);
    }

    void save(const std::string &path) const { check(dunkelfeld_film_save(get(), path.c_str())); }

    /** Writes the files of `dunkelfeld render` with the same bytes. */
    void save_files(const Files &files) const {
        check(dunkelfeld_film_save_files(get(), detail::text(files.image), detail::text(files.linear), detail::text(files.exr),
                                         detail::text(files.stats), detail::text(files.plan)));
    }

    /** Mean radiance [W/(m^2 sr)], linear Rec. 709, 3 channels. */
    Image<float> mean() const { return layer(DUNKELFELD_LAYER_MEAN, 3); }
    /** Variance of the mean, 3 channels. */
    Image<float> variance() const { return layer(DUNKELFELD_LAYER_VARIANCE, 3); }
    /** Mean unit normal toward the camera, world axes, 3 channels. */
    Image<float> normal() const { return layer(DUNKELFELD_LAYER_NORMAL, 3); }
    /** Mean albedo, linear Rec. 709, 3 channels. */
    Image<float> albedo() const { return layer(DUNKELFELD_LAYER_ALBEDO, 3); }
    /** Mean distance from the camera along its axis [m]. */
    Image<float> depth() const { return layer(DUNKELFELD_LAYER_DEPTH, 1); }
    /** Samples per pixel. */
    Image<std::uint32_t> spp() const { return ids(DUNKELFELD_ID_LAYER_SPP); }
    /** Object at the centre of each pixel, or DUNKELFELD_NO_ID; behind a smooth clear surface the first that scatters. */
    Image<std::uint32_t> object_ids() const { return ids(DUNKELFELD_ID_LAYER_OBJECT_IDS); }
    /** Material at the centre of each pixel, or DUNKELFELD_NO_ID. */
    Image<std::uint32_t> material_ids() const { return ids(DUNKELFELD_ID_LAYER_MATERIAL_IDS); }

    std::string object_name(std::uint32_t id) const {
        char *name = nullptr;
        check(dunkelfeld_film_object_name(get(), id, &name));
        return detail::take(name);
    }

    std::string material_name(std::uint32_t id) const {
        char *name = nullptr;
        check(dunkelfeld_film_material_name(get(), id, &name));
        return detail::take(name);
    }

    /** Grey values [DN] of `frames` frames. `keys` are lines of TOML: model, exposure and exposure_noise of [sensor], seed, frame. */
    std::vector<Image<std::uint16_t>> expose(const std::string &keys = "", std::uint32_t frames = 1) const {
        const auto [width, height] = size();
        const std::size_t pixels = std::size_t(width) * height;
        std::vector<std::uint16_t> values(pixels * frames);
        DunkelfeldExposeOptions c = dunkelfeld_expose_options();
        c.keys = keys.c_str();
        check(dunkelfeld_film_expose(get(), &c, frames, values.data(), values.size()));
        std::vector<Image<std::uint16_t>> images;
        for (std::size_t f = 0; f < frames; ++f) {
            const auto first = values.begin() + std::ptrdiff_t(f * pixels);
            images.push_back({width, height, 1, std::vector<std::uint16_t>(first, first + std::ptrdiff_t(pixels))});
        }
        return images;
    }

    /** The 8-bit picture of one frame, gamma 2.2, of 1 or 3 channels. */
    Image<std::uint8_t> picture(const std::string &keys = "") const {
        const auto [width, height] = size();
        Image<std::uint8_t> image{width, height, 3, std::vector<std::uint8_t>(std::size_t(width) * height * 3)};
        DunkelfeldExposeOptions c = dunkelfeld_expose_options();
        c.keys = keys.c_str();
        check(dunkelfeld_film_picture(get(), &c, image.data.data(), image.data.size(), 0, &image.channels));
        image.data.resize(std::size_t(width) * height * image.channels);
        return image;
    }

    DunkelfeldCertificate certificate(double k = 1.0) const {
        DunkelfeldCertificate certificate = dunkelfeld_certificate();
        check(dunkelfeld_film_certificate(get(), detail::number(k), &certificate));
        return certificate;
    }

    /** The denoised mean, 3 channels. `method` is "auto", "oidn" or "builtin". */
    Image<float> denoise(const std::string &method = "auto") const {
        const auto [width, height] = size();
        Image<float> image{width, height, 3, std::vector<float>(std::size_t(width) * height * 3)};
        check(dunkelfeld_film_denoise(get(), method.c_str(), image.data.data(), image.data.size(), 0));
        return image;
    }

    /** The statistics of the render as JSON. */
    std::string stats() const {
        char *json = nullptr;
        check(dunkelfeld_film_stats(get(), &json));
        return detail::take(json);
    }

    /** Width and height [pixels]. */
    std::pair<std::uint32_t, std::uint32_t> size() const {
        std::uint32_t width = 0, height = 0;
        check(dunkelfeld_film_size(get(), &width, &height));
        return {width, height};
    }

    DunkelfeldFilm *get() const noexcept { return handle_.get(); }

private:
    Image<float> layer(DunkelfeldLayer layer, std::uint32_t channels) const {
        const auto [width, height] = size();
        Image<float> image{width, height, channels, std::vector<float>(std::size_t(width) * height * channels)};
        check(dunkelfeld_film_read(get(), layer, image.data.data(), image.data.size(), 0));
        return image;
    }

    Image<std::uint32_t> ids(DunkelfeldIdLayer layer) const {
        const auto [width, height] = size();
        Image<std::uint32_t> image{width, height, 1, std::vector<std::uint32_t>(std::size_t(width) * height)};
        check(dunkelfeld_film_read_ids(get(), layer, image.data.data(), image.data.size(), 0));
        return image;
    }

    std::shared_ptr<DunkelfeldFilm> handle_;
};

/** A render that was cancelled. `film` has the samples until then. */
class Interrupted : public Error {
public:
    explicit Interrupted(Film film) : Error(DUNKELFELD_STATUS_INTERRUPTED), film(std::move(film)) {}
    Film film;
};

/** A scene or a job. It serves one call at a time. */
class Scene {
public:
    /** Opens a scene (.glb, .gltf, .obj, .stl, .ply) or a job (.toml). */
    explicit Scene(const std::string &path) {
        DunkelfeldScene *scene = nullptr;
        check(dunkelfeld_scene_open(path.c_str(), &scene));
        handle_.reset(scene);
    }

    /** Opens a job from its text (TOML). Paths in it are relative to `folder`. */
    static Scene from_job(const std::string &job, const std::string &folder = "") {
        DunkelfeldScene *scene = nullptr;
        check(dunkelfeld_scene_from_job(job.c_str(), folder.c_str(), &scene));
        return Scene(scene);
    }

    /** Changes scene and settings by keys of a job (TOML). */
    void set_overrides(const std::string &overrides) { check(dunkelfeld_scene_set_overrides(get(), overrides.c_str())); }

    /** The content of the scene as JSON. */
    std::string inspect() {
        char *json = nullptr;
        check(dunkelfeld_scene_inspect(get(), &json));
        return detail::take(json);
    }

    /** Renders. A cancelled render throws Interrupted, unless `progress` threw. */
    Film render(const RenderOptions &options = {}) {
        Progress progress{options.progress, nullptr};
        DunkelfeldRenderOptions c = dunkelfeld_render_options();
        c.keys = options.keys.c_str();
        c.camera = detail::text(options.camera);
        c.checkpoint = detail::text(options.checkpoint);
        c.threads = options.threads.value_or(0);
        if (options.samples) std::tie(c.samples_from, c.samples_to) = *options.samples;
        c.progress = options.progress ? &Progress::call : nullptr;
        c.user = &progress;
        c.cancel = options.cancel ? options.cancel->get() : nullptr;
        DunkelfeldFilm *handle = nullptr;
        const DunkelfeldStatus status = dunkelfeld_scene_render(get(), &c, &handle);
        if (status != DUNKELFELD_STATUS_OK && status != DUNKELFELD_STATUS_INTERRUPTED) throw Error(status);
        Film film(handle);
        if (progress.thrown) std::rethrow_exception(progress.thrown);
        if (status == DUNKELFELD_STATUS_INTERRUPTED) throw Interrupted(std::move(film));
        return film;
    }

    DunkelfeldScene *get() const noexcept { return handle_.get(); }

private:
    /** Calls a function of C++ and keeps its exception. */
    struct Progress {
        const std::function<bool(const DunkelfeldProgress &)> &function;
        std::exception_ptr thrown;

        static int call(void *user, const DunkelfeldProgress *state) {
            auto &self = *static_cast<Progress *>(user);
            if (self.thrown) return 1;
            try {
                return self.function(*state) ? 0 : 1;
            } catch (...) {
                self.thrown = std::current_exception();
                return 1;
            }
        }
    };

    explicit Scene(DunkelfeldScene *scene) : handle_(scene) {}

    std::unique_ptr<DunkelfeldScene, detail::CloseScene> handle_;
};

/** Joins parts of one render (checkpoints with disjoint samples). */
inline Film merge(const std::vector<std::string> &paths, std::uint32_t threads = 0) {
    std::vector<const char *> c;
    for (const std::string &path : paths) c.push_back(path.c_str());
    DunkelfeldFilm *film = nullptr;
    check(dunkelfeld_merge(c.data(), c.size(), threads, &film));
    return Film(film);
}

/** Names of the preset sensors as a JSON array. */
inline std::string sensors() {
    char *names = nullptr;
    check(dunkelfeld_sensors(&names));
    return detail::take(names);
}

} // namespace dunkelfeld

#endif
