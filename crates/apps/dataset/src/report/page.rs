//! The page of a set: its head, a selection of its images, and the sections.

use super::cost_section::{cost_section, image_seconds, noise_section};
use super::draw_section::draw_section;
use super::label_section::{findable, label_section};
use super::overlay::{overlay, pen};
use super::summary::Summary;
use super::view::SetView;
use crate::run::MOST_SATURATED;
use crate::set::read_bytes;
use dunkelfeld::{Error, InputError};
use dunkelfeld_film::Plane;
use dunkelfeld_io::picture::Picture;
use dunkelfeld_io::png::data_uri;
use dunkelfeld_report::page::{self as frame, head, tiles};
use dunkelfeld_report::words::{bytes, counted, duration, percent, shortened};
use image::DynamicImage;
use maud::{Markup, html};

/// Images with their labels, the key of the categories, and narrow tables.
const STYLE: &str = include_str!("style.css");
/// Maximum number of images in the page.
const IMAGES: usize = 24;
/// The longest side of an image in the page [px].
const SIDE: u32 = 256;
/// Maximum number of sizes of images in the head.
const SIZES: usize = 3;

/// The page of a set as HTML.
pub(crate) fn page(set: &SetView<'_>) -> Result<String, Error> {
    let sections =
        [top(set), images(set)?, label_section(set), draw_section(set), noise_section(set), cost_section(set)];
    Ok(frame::page(&format!("{} \u{b7} data set", set.set.manifest().study), STYLE, &sections))
}

fn top(set: &SetView<'_>) -> Markup {
    let (about, done) = (set.set.manifest(), set.finished.len() as u64);
    let mut sizes: Vec<(&[u32; 2], &u64)> = set.sizes.iter().collect();
    sizes.sort_by_key(|(_, n)| std::cmp::Reverse(**n));
    let mut facts: Vec<String> = sizes.iter().take(SIZES).map(|([w, h], _)| format!("{w} \u{d7} {h} pixels")).collect();
    facts.extend((sizes.len() > SIZES).then(|| format!("{} other sizes", sizes.len() - SIZES)));
    facts.extend([format!("study {}", shortened(&about.study_hash, 24)), shortened(&about.program, 40)]);
    html! {
        (head(&format!("Data set: {}", about.study), &facts.join(" \u{b7} ")))
        @if done < about.count {
            div.banner { "Not finished: " (done) " of " (counted(about.count, "image")) ". The same command continues the set. \
                This page uses the finished images." }
        }
        (tiles(&figures(set)))
    }
}

/// The main figures of the set.
fn figures(set: &SetView<'_>) -> Vec<(String, String)> {
    let (done, all) = (set.finished.len() as u64, set.set.count());
    let instances: usize = set.labels.iter().map(|l| l.instances.len()).sum();
    let used = set.labels.iter().filter(|l| !l.instances.is_empty()).count();
    let images = if done == all { done.to_string() } else { format!("{done} of {all}") };
    let mut tiles = vec![
        (images, if all == 1 { "image".into() } else { "images".into() }),
        (instances.to_string(), format!("labels in {used} of {} categories", set.labels.len())),
    ];
    if set.set.manifest().categories.iter().any(|c| c.is_defect) && done > 0 {
        tiles.push((percent(set.with_defects as f64 / done as f64), "of the images contain a defect".into()));
    }
    if let Some(share) = findable(set) {
        tiles.push((percent(share), "of the defects have a contrast-to-noise ratio above 3".into()));
    }
    let saturated = Summary::of(set.saturated.iter().copied()).mean;
    if saturated > MOST_SATURATED {
        tiles.push((percent(saturated), "of the pixels are saturated, and show no contrast".into()));
    }
    if let Some(seconds) = image_seconds(set) {
        let rest = all.saturating_sub(done);
        let more = match rest {
            0 => format!("{} in all", duration(seconds * done as f64)),
            _ => format!("{} more for {}", duration(seconds * rest as f64), counted(rest, "image")),
        };
        tiles.push((duration(seconds), format!("per image \u{b7} {more}")));
    }
    let total = set.bytes as f64;
    if total > 0.0 && done > 0 {
        tiles.push((bytes(total), format!("in files \u{b7} {} per image", bytes(total / done as f64))));
    }
    tiles
}

fn images(set: &SetView<'_>) -> Result<Markup, Error> {
    let mut thumbs = Vec::new();
    let mut positions = std::collections::BTreeSet::new();
    let mut shape = 1.0_f64;
    for index in set.evenly(IMAGES) {
        let record = set.set.record(index)?;
        let Some(file) = record.files.keys().find(|name| name.starts_with("images/")) else { continue };
        let labels = overlay(set, &record)?;
        if thumbs.is_empty() {
            shape = (f64::from(record.width) / f64::from(record.height.max(1))).clamp(0.5, 3.0);
        }
        positions.extend(record.instances.iter().filter_map(|label| set.position(label.category)));
        thumbs.push(html! {
            figure {
                a href=(file) {
                    img src=(thumb(set, file)?) alt={ "image " (index) };
                    (labels)
                }
                figcaption { (index) " \u{b7} " (counted(record.instances.len() as u64, "label")) }
            }
        });
    }
    let categories = &set.set.manifest().categories;
    let n = thumbs.len();
    Ok(html! {
        section {
            h2 { "Images" }
            @if n == 0 {
                p { "No image is finished." }
            } @else {
                p { (selection(n, set.finished.len())) " Outlines enclose the visible pixels of an instance. A box \
                    encloses a small instance, or the bounding box if there is no mask. Each image is a link to its \
                    file." }
                ul.key {
                    @for i in &positions { li { (swatch(*i)) (shortened(&categories[*i].name, 80)) } }
                }
                input.choice #with-labels type="radio" name="labels" checked;
                label for="with-labels" { "with labels" }
                input.choice #without-labels type="radio" name="labels";
                label for="without-labels" { "without" }
                div.thumbs style={ "--shape:" (format!("{shape:.3}")) } { @for thumb in &thumbs { (thumb) } }
            }
        }
    })
}

/// An image of the set as an address, scaled down.
fn thumb(set: &SetView<'_>, name: &str) -> Result<String, Error> {
    let failed = |problem: String| {
        let help = "delete the record of the image, and run the command again";
        InputError::new(set.set.path().join(name), "the file", problem, help)
    };
    let bytes = read_bytes(set.set.path(), name)?;
    let image = image::load_from_memory(&bytes).map_err(|e| failed(format!("the image cannot be read: {e}")))?;
    let image = if image.width().max(image.height()) > SIDE { image.thumbnail(SIDE, SIDE) } else { image };
    let (width, height) = (image.width(), image.height());
    let uri = match image {
        DynamicImage::ImageLuma8(gray) => {
            Plane::from_vec(width, height, gray.into_raw()).map(|plane| data_uri(Picture::Gray8(&plane)))
        }
        other => {
            let pixels = other.into_rgb8().pixels().map(|pixel| pixel.0).collect();
            Plane::from_vec(width, height, pixels).map(|plane| data_uri(Picture::Rgb8(&plane)))
        }
    };
    Ok(uri.and_then(Result::ok).ok_or_else(|| failed("the image has no pixels".into()))?)
}

fn selection(n: usize, all: usize) -> String {
    match n == all {
        true => "All images, in order.".into(),
        false => format!("{n} of {all} images, evenly over the set."),
    }
}

/// The sign of a category, as in the images.
pub(crate) fn swatch(position: usize) -> Markup {
    html! {
        svg class="swatch" viewBox="0 0 16 16" aria-hidden="true" {
            rect x="3" y="3" width="10" height="10" {}
            rect class=(pen(position)) x="3" y="3" width="10" height="10" {}
        }
    }
}
