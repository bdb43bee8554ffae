/* Calls the interface with bad input. Every call returns a status; none crashes. */

#include "dunkelfeld.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void expect(int line, DunkelfeldStatus expected, DunkelfeldStatus status) {
    const char *message = dunkelfeld_last_error(DUNKELFELD_ERROR_PART_MESSAGE);
    if (status != expected) {
        fprintf(stderr, "line %d: status %d instead of %d: %s\n", line, status, expected, message ? message : "no message");
        exit(1);
    }
    if ((status == DUNKELFELD_STATUS_OK) != (message == NULL)) {
        fprintf(stderr, "line %d: status %d with the message %s\n", line, status, message ? message : "NULL");
        exit(1);
    }
}

#define EXPECT(status, call) expect(__LINE__, DUNKELFELD_STATUS_##status, call)
#define CHECK(truth)                                                                                                           \
    do {                                                                                                                       \
        if (!(truth)) {                                                                                                        \
            fprintf(stderr, "line %d: %s\n", __LINE__, #truth);                                                                \
            exit(1);                                                                                                           \
        }                                                                                                                      \
    } while (0)

static DunkelfeldScene *scene;

static int stop(void *user, const DunkelfeldProgress *progress) {
    CHECK(progress->stage && strlen(progress->stage) > 0);
    *(int *)user += 1;
    return 1;
}

/* A progress function that uses its own scene. */
static int meddle(void *user, const DunkelfeldProgress *progress) {
    (void)progress;
    *(int *)user = (int)dunkelfeld_scene_set_overrides(scene, "");
    return 0;
}

/* A progress function that reads and exposes a film, while other threads of the render may report as well. */
static int read_another(void *user, const DunkelfeldProgress *progress) {
    float depth[24 * 16];
    uint16_t frame[24 * 16];
    (void)progress;
    EXPECT(OK, dunkelfeld_film_read(user, DUNKELFELD_LAYER_DEPTH, depth, 24 * 16, 0));
    EXPECT(OK, dunkelfeld_film_expose(user, NULL, 1, frame, 24 * 16));
    return 0;
}

static void *read_film(void *film) {
    float depth[24 * 16];
    for (int i = 0; i < 50; i++) EXPECT(OK, dunkelfeld_film_read(film, DUNKELFELD_LAYER_DEPTH, depth, 24 * 16, 0));
    EXPECT(ARGUMENT, dunkelfeld_film_read(film, DUNKELFELD_LAYER_DEPTH, NULL, 24 * 16, 0));
    return NULL;
}

int main(int argc, char **argv) {
    /* Another argument stands for few samples: under valgrind all takes longer. */
    const int few = argc > 2;
    CHECK(argc >= 2);
    DunkelfeldFilm *film = NULL, *other = NULL;
    char *text = NULL;
    uint32_t width = 0, height = 0, channels = 0;

    /* Version. */
    CHECK(dunkelfeld_abi_version() == DUNKELFELD_ABI_VERSION && strlen(dunkelfeld_version()) >= 5);
    EXPECT(OK, dunkelfeld_check_abi(DUNKELFELD_ABI_VERSION));
    EXPECT(ABI, dunkelfeld_check_abi(DUNKELFELD_ABI_VERSION + 1));

    /* Scenes. */
    EXPECT(ARGUMENT, dunkelfeld_scene_open(NULL, &scene));
    EXPECT(ARGUMENT, dunkelfeld_scene_open(argv[1], NULL));
    EXPECT(ARGUMENT, dunkelfeld_scene_open("\xff\xfe.glb", &scene));
    EXPECT(INPUT, dunkelfeld_scene_open("there-is-no-such-file.glb", &scene));
    CHECK(scene == NULL && strstr(dunkelfeld_last_error(DUNKELFELD_ERROR_PART_FILE), "no-such-file"));
    CHECK(dunkelfeld_last_error(DUNKELFELD_ERROR_PART_HELP) && !dunkelfeld_last_error(99) && !dunkelfeld_last_error(-1));
    EXPECT(INPUT, dunkelfeld_scene_from_job("film = { width = 'wide' }", NULL, &scene));
    EXPECT(OK, dunkelfeld_scene_open(argv[1], &scene));
    EXPECT(INPUT, dunkelfeld_scene_set_overrides(scene, "[[object]]\nname = 'nothing'\nvisible = false\n"));
    EXPECT(INPUT, dunkelfeld_scene_set_overrides(scene, "this is not TOML"));
    EXPECT(ARGUMENT, dunkelfeld_scene_set_overrides(scene, NULL));
    EXPECT(ARGUMENT, dunkelfeld_scene_inspect(scene, NULL));
    EXPECT(OK, dunkelfeld_scene_inspect(scene, &text));
    CHECK(strstr(text, "\"part\""));
    dunkelfeld_text_close(text);
    dunkelfeld_text_close(NULL);

    /* Options. */
    DunkelfeldRenderOptions options = dunkelfeld_render_options();
    static const char *const refused[] = {
        "allocate.strategy = 'best'", "budget.spp = nan", "budget.spp = -1", "sensor.model = 'no-such-sensor'",
        "sensor = { model = 'none', exposure = '1ms' }", "sensor.exposure = inf", "film.width = 2147483648", "no TOML", "no.key = 1",
    };
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        options.keys = refused[i];
        EXPECT(INPUT, dunkelfeld_scene_render(scene, &options, &film));
    }
    options.keys = "light = [{ name = 'lamp', enabled = false }]";
    EXPECT(SETTING, dunkelfeld_scene_render(scene, &options, &film));
    options.keys = "budget.spp = 4";
    options.camera = "nobody";
    EXPECT(SETTING, dunkelfeld_scene_render(scene, &options, &film));
    options.camera = NULL;
    options.threads = 20000;
    EXPECT(SETTING, dunkelfeld_scene_render(scene, &options, &film));
    options.threads = 0;
    options.samples_from = 5;
    EXPECT(SETTING, dunkelfeld_scene_render(scene, &options, &film));
    options.samples_from = 0;
    options.cancel = (DunkelfeldCancel *)scene;
    EXPECT(ARGUMENT, dunkelfeld_scene_render(scene, &options, &film));
    options.cancel = NULL;
    options.struct_size = 3;
    EXPECT(ABI, dunkelfeld_scene_render(scene, &options, &film));
    options.struct_size = offsetof(DunkelfeldRenderOptions, camera) + 4;
    EXPECT(ABI, dunkelfeld_scene_render(scene, &options, &film));
    options.struct_size = sizeof options + 8;
    EXPECT(ABI, dunkelfeld_scene_render(scene, &options, &film));
    EXPECT(ARGUMENT, dunkelfeld_scene_render(scene, NULL, NULL));
    EXPECT(ARGUMENT, dunkelfeld_scene_render(NULL, NULL, &film));
    CHECK(film == NULL);
    /* A program with an older header: the fields beyond its size are not read. */
    options.struct_size = offsetof(DunkelfeldRenderOptions, checkpoint);
    options.checkpoint = "\xff";
    EXPECT(OK, dunkelfeld_scene_render(scene, &options, &film));
    EXPECT(OK, dunkelfeld_film_close(film));
    options = dunkelfeld_render_options();

    /* A render that its progress function cancels, one that a switch cancelled before, and one that is used by itself. */
    int calls = 0;
    options.keys = "budget.time = 60";
    options.progress = stop;
    options.user = &calls;
    CHECK(dunkelfeld_scene_render(scene, &options, &film) == DUNKELFELD_STATUS_INTERRUPTED);
    CHECK(strstr(dunkelfeld_last_error(DUNKELFELD_ERROR_PART_PROBLEM), "cancelled"));
    CHECK(calls > 0 && film);
    EXPECT(OK, dunkelfeld_film_close(film));
    DunkelfeldCancel *cancel = NULL;
    EXPECT(OK, dunkelfeld_cancel_new(&cancel));
    EXPECT(OK, dunkelfeld_cancel(cancel));
    options.progress = NULL;
    options.cancel = cancel;
    CHECK(dunkelfeld_scene_render(scene, &options, &film) == DUNKELFELD_STATUS_INTERRUPTED);
    EXPECT(OK, dunkelfeld_film_close(film));
    EXPECT(OK, dunkelfeld_cancel_close(cancel));
    EXPECT(ARGUMENT, dunkelfeld_cancel_close(cancel));
    options.cancel = NULL;
    options.keys = NULL;
    int meddled = -1;
    options.progress = meddle;
    options.user = &meddled;
    EXPECT(OK, dunkelfeld_scene_render(scene, &options, &film));
    CHECK(meddled == DUNKELFELD_STATUS_BUSY);

    options.progress = read_another;
    options.user = film;
    options.keys = few ? "budget.spp = 40" : "budget.spp = 4000";
    for (uint32_t threads = 2; threads <= (few ? 2 : 32); threads *= 4) {
        options.threads = threads;
        EXPECT(OK, dunkelfeld_scene_render(scene, &options, &other));
        EXPECT(OK, dunkelfeld_film_close(other));
    }
    other = NULL;

    /* Buffers. */
    static float mean[16][100];
    memset(mean, 0x7f, sizeof mean);
    EXPECT(OK, dunkelfeld_film_size(film, &width, &height));
    CHECK(width == 24 && height == 16);
    EXPECT(ARGUMENT, dunkelfeld_film_size(film, &width, NULL));
    EXPECT(OK, dunkelfeld_film_read(film, DUNKELFELD_LAYER_MEAN, mean[0], 16 * 100, 100));
    float before;
    memset(&before, 0x7f, sizeof before);
    for (int y = 0; y < 16; y++) CHECK(mean[y][0] < 1e3f && mean[y][71] < 1e3f && memcmp(&mean[y][72], &before, sizeof before) == 0);
    EXPECT(OK, dunkelfeld_film_read(film, DUNKELFELD_LAYER_MEAN, mean[0], 15 * 100 + 72, 100));
    EXPECT(ARGUMENT, dunkelfeld_film_read(film, DUNKELFELD_LAYER_MEAN, mean[0], 15 * 100 + 71, 100));
    EXPECT(ARGUMENT, dunkelfeld_film_read(film, DUNKELFELD_LAYER_MEAN, mean[0], 16 * 100, 71));
    EXPECT(ARGUMENT, dunkelfeld_film_read(film, DUNKELFELD_LAYER_MEAN, mean[0], SIZE_MAX, SIZE_MAX));
    EXPECT(ARGUMENT, dunkelfeld_film_read(film, DUNKELFELD_LAYER_MEAN, (float *)((char *)mean + 1), 16 * 72, 0));
    EXPECT(ARGUMENT, dunkelfeld_film_read(film, DUNKELFELD_LAYER_MEAN, NULL, 16 * 72, 0));
    EXPECT(ARGUMENT, dunkelfeld_film_read(film, 77, mean[0], 16 * 72, 0));
    EXPECT(ARGUMENT, dunkelfeld_film_read((DunkelfeldFilm *)scene, DUNKELFELD_LAYER_MEAN, mean[0], 16 * 72, 0));
    uint32_t ids[24 * 16];
    EXPECT(OK, dunkelfeld_film_read_ids(film, DUNKELFELD_ID_LAYER_OBJECT_IDS, ids, 24 * 16, 0));
    EXPECT(ARGUMENT, dunkelfeld_film_read_ids(film, -1, ids, 24 * 16, 0));
    EXPECT(OK, dunkelfeld_film_object_name(film, ids[8 * 24 + 12], &text));
    CHECK(strcmp(text, "part") == 0);
    dunkelfeld_text_close(text);
    EXPECT(ARGUMENT, dunkelfeld_film_object_name(film, 1000, &text));
    EXPECT(ARGUMENT, dunkelfeld_film_material_name(film, DUNKELFELD_NO_ID, &text));
    EXPECT(OK, dunkelfeld_film_name_counts(film, &width, &channels));

    /* Exposures. */
    static uint16_t frames[3 * 24 * 16];
    DunkelfeldExposeOptions exposure = dunkelfeld_expose_options();
    EXPECT(OK, dunkelfeld_film_expose(film, NULL, 3, frames, 3 * 24 * 16));
    CHECK(memcmp(frames, frames + 24 * 16, 24 * 16 * 2) != 0);
    EXPECT(ARGUMENT, dunkelfeld_film_expose(film, &exposure, 3, frames, 3 * 24 * 16 - 1));
    EXPECT(ARGUMENT, dunkelfeld_film_expose(film, &exposure, UINT32_MAX, frames, 3 * 24 * 16));
    EXPECT(SETTING, dunkelfeld_film_expose(film, &exposure, 0, frames, 3 * 24 * 16));
    exposure.keys = "sensor.exposure_noise = 'matched'";
    EXPECT(SETTING, dunkelfeld_film_expose(film, &exposure, 2, frames, 3 * 24 * 16));
    exposure.keys = "sensor.exposure_noise = 'some'";
    EXPECT(INPUT, dunkelfeld_film_expose(film, &exposure, 1, frames, 3 * 24 * 16));
    exposure.keys = "sensor.exposure = nan";
    EXPECT(INPUT, dunkelfeld_film_expose(film, &exposure, 1, frames, 3 * 24 * 16));
    exposure.keys = "budget.spp = 4";
    EXPECT(SETTING, dunkelfeld_film_expose(film, &exposure, 1, frames, 3 * 24 * 16));
    exposure.keys = "sensor = { model = 'imx174', exposure = 'auto' }";
    EXPECT(OK, dunkelfeld_film_expose(film, &exposure, 1, frames, 3 * 24 * 16));
    static uint8_t picture[3 * 24 * 16];
    exposure.keys = "sensor.model = 'none'";
    EXPECT(OK, dunkelfeld_film_picture(film, &exposure, NULL, 0, 0, &channels));
    CHECK(channels == 3);
    EXPECT(ARGUMENT, dunkelfeld_film_picture(film, &exposure, picture, 24 * 16, 0, &channels));
    EXPECT(OK, dunkelfeld_film_picture(film, NULL, picture, 24 * 16, 0, &channels));
    CHECK(channels == 1);
    DunkelfeldCertificate certificate = dunkelfeld_certificate();
    EXPECT(OK, dunkelfeld_film_certificate(film, 2.0, &certificate));
    CHECK(certificate.k == 2.0 && certificate.hidden >= 0.0 && certificate.hidden <= 1.0 && certificate.pixels == 24 * 16);
    EXPECT(SETTING, dunkelfeld_film_certificate(film, -1.0, &certificate));
    EXPECT(ARGUMENT, dunkelfeld_film_certificate(film, 1.0, NULL));
    EXPECT(OK, dunkelfeld_film_denoise(film, "builtin", mean[0], 16 * 100, 0));
    EXPECT(SETTING, dunkelfeld_film_denoise(film, "magic", mean[0], 16 * 100, 0));

    /* Files. */
    EXPECT(OK, dunkelfeld_film_save(film, "a.film"));
    EXPECT(OUTPUT, dunkelfeld_film_save(film, "no-such-folder/a.film"));
    EXPECT(OK, dunkelfeld_film_save_files(film, "a.png", "a.tif", "a.exr", "a.json", "plan.exr"));
    EXPECT(SETTING, dunkelfeld_film_save_files(film, NULL, NULL, NULL, NULL, NULL));
    EXPECT(OUTPUT, dunkelfeld_film_save_files(film, "a.jpg", NULL, NULL, NULL, NULL));
    EXPECT(OUTPUT, dunkelfeld_film_save_files(film, NULL, NULL, "b.exr", NULL, "b.exr"));
    EXPECT(ARGUMENT, dunkelfeld_film_save_files(film, "\xff.png", NULL, NULL, NULL, NULL));
    EXPECT(ARGUMENT, dunkelfeld_film_save_files((DunkelfeldFilm *)scene, "b.png", NULL, NULL, NULL, NULL));
    EXPECT(OUTPUT, dunkelfeld_film_save(film, argv[1]));
    CHECK(strstr(dunkelfeld_last_error(DUNKELFELD_ERROR_PART_PROBLEM), "reads"));
    EXPECT(OK, dunkelfeld_film_load("a.film", &other));
    EXPECT(SETTING, dunkelfeld_film_save_files(other, NULL, NULL, NULL, "b.json", NULL));
    EXPECT(OUTPUT, dunkelfeld_film_save(other, "a.film"));
    static float again[16 * 72], once[16 * 72];
    EXPECT(OK, dunkelfeld_film_read(film, DUNKELFELD_LAYER_VARIANCE, once, 16 * 72, 0));
    EXPECT(OK, dunkelfeld_film_read(other, DUNKELFELD_LAYER_VARIANCE, again, 16 * 72, 0));
    CHECK(memcmp(once, again, sizeof once) == 0);
    EXPECT(OK, dunkelfeld_film_close(other));
    EXPECT(INPUT, dunkelfeld_film_load(argv[1], &other));
    EXPECT(INPUT, dunkelfeld_merge((const char *const[]){"a.film"}, 1, 0, &other));
    CHECK(strstr(dunkelfeld_last_error(DUNKELFELD_ERROR_PART_PROBLEM), "saved film"));
    const char *parts[2] = {"a.film", NULL};
    EXPECT(SETTING, dunkelfeld_merge(parts, 0, 0, &other));
    EXPECT(ARGUMENT, dunkelfeld_merge(NULL, 2, 0, &other));
    EXPECT(ARGUMENT, dunkelfeld_merge(parts, 2, 0, &other));
    EXPECT(OK, dunkelfeld_film_stats(film, &text));
    CHECK(strstr(text, "\"samples\""));
    dunkelfeld_text_close(text);

    /* Several threads read one film, and each has its own error. */
    pthread_t threads[4];
    for (int i = 0; i < 4; i++) CHECK(pthread_create(&threads[i], NULL, read_film, film) == 0);
    for (int i = 0; i < 4; i++) CHECK(pthread_join(threads[i], NULL) == 0);
    EXPECT(OK, dunkelfeld_sensors(&text));
    CHECK(strstr(text, "imx250"));
    dunkelfeld_text_close(text);

    /* Closed handles. */
    EXPECT(OK, dunkelfeld_film_close(film));
    EXPECT(ARGUMENT, dunkelfeld_film_close(film));
    EXPECT(ARGUMENT, dunkelfeld_film_size(film, &width, &height));
    EXPECT(OK, dunkelfeld_film_close(NULL));
    EXPECT(OK, dunkelfeld_scene_close(scene));
    EXPECT(ARGUMENT, dunkelfeld_scene_close(scene));
    EXPECT(ARGUMENT, dunkelfeld_scene_render(scene, NULL, &film));
    puts("all statuses are as expected");
    return 0;
}
