/*
 * Renders a scene in C, exposes it, and writes its picture as a binary PGM or PPM file.
 *
 *     render SCENE OUT.pgm [SPP]
 */

#include "dunkelfeld.h"

#include <stdio.h>
#include <stdlib.h>

/* Prints the error of the last call. */
static int fail(void) {
    fprintf(stderr, "error: %s\n", dunkelfeld_last_error(DUNKELFELD_ERROR_PART_MESSAGE));
    return 1;
}

static int on_progress(void *user, const DunkelfeldProgress *progress) {
    (void)user;
    fprintf(stderr, "\r%s %3.0f %%   ", progress->stage, 100.0 * progress->fraction);
    return 0;
}

static int write_picture(const DunkelfeldFilm *film, const char *path) {
    uint32_t width, height, channels;
    if (dunkelfeld_film_size(film, &width, &height) != DUNKELFELD_STATUS_OK) return fail();
    const size_t count = (size_t)width * height * 3;
    uint8_t *picture = malloc(count);
    if (!picture) return 1;
    int result = 1;
    if (dunkelfeld_film_picture(film, NULL, picture, count, 0, &channels) != DUNKELFELD_STATUS_OK) {
        fail();
    } else {
        FILE *file = fopen(path, "wb");
        const size_t size = (size_t)width * height * channels;
        if (file) {
            fprintf(file, "P%c\n%u %u\n255\n", channels == 1 ? '5' : '6', width, height);
            result = fwrite(picture, 1, size, file) == size ? 0 : 1;
            if (fclose(file) != 0) result = 1;
        }
        if (result != 0) perror(path);
    }
    free(picture);
    return result;
}

int main(int argc, char **argv) {
    if (argc < 3) {
        fprintf(stderr, "usage: %s SCENE OUT.pgm [SPP]\n", argv[0]);
        return 2;
    }
    if (dunkelfeld_check_abi(DUNKELFELD_ABI_VERSION) != DUNKELFELD_STATUS_OK) return fail();

    DunkelfeldScene *scene = NULL;
    if (dunkelfeld_scene_open(argv[1], &scene) != DUNKELFELD_STATUS_OK) return fail();

    DunkelfeldRenderOptions options = dunkelfeld_render_options();
    char keys[64];
    snprintf(keys, sizeof keys, "budget.spp = %.17g", argc > 3 ? atof(argv[3]) : 16.0);
    options.keys = keys;
    options.progress = on_progress;
    DunkelfeldFilm *film = NULL;
    const DunkelfeldStatus status = dunkelfeld_scene_render(scene, &options, &film);
    fputc('\n', stderr);
    int result = status == DUNKELFELD_STATUS_OK ? write_picture(film, argv[2]) : fail();

    DunkelfeldCertificate certificate = dunkelfeld_certificate();
    if (result == 0 && dunkelfeld_film_certificate(film, 1.0, &certificate) == DUNKELFELD_STATUS_OK) {
        printf("%.1f %% of the pixels are hidden beneath the noise of the sensor\n", 100.0 * certificate.hidden);
    }
    dunkelfeld_film_close(film);
    dunkelfeld_scene_close(scene);
    return result;
}
