//! The layers of a render in an EXR: their names in the files of this program and of other programs.

use dunkelfeld_film::Plane;

use crate::exr::{Channel, ExrLayers};

/// A layer with three components per pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Triple {
    /// Unbiased mean radiance: `R G B`.
    Mean,
    /// Variance of the mean: `variance.R/G/B`.
    Variance,
    /// Covariance of the mean's channels, two by two: `covariance.RG/RB/GB`.
    Covariance,
    /// Denoised mean: `denoised.R/G/B`.
    Denoised,
    /// The part of the mean that is first light: `first_light.R/G/B`.
    FirstLight,
    /// Mean of the radiance times the place of its samples in the pixel, to the right: `moment.x.R/G/B`.
    MomentX,
    /// The same downward: `moment.y.R/G/B`.
    MomentY,
    /// Mean radiance behind a lens that blurs: `lens.R/G/B`.
    Lens,
    /// Reflectance of the first surface that scatters light, behind smooth glass: `albedo.R/G/B`.
    Albedo,
    /// Shading normal of that surface: `normal.X/Y/Z`.
    Normal,
    /// Variance of the mean albedo: `albedo.variance.R/G/B`.
    AlbedoVariance,
    /// Variance of the mean normal: `normal.variance.X/Y/Z`.
    NormalVariance,
}

/// A layer with one number per pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Single {
    /// Samples per pixel: `spp.Y`.
    SampleCount,
    /// Variance of the mean luminance, as of independent samples: `scatter.Y`.
    Scatter,
    /// The largest sample's contribution to it: `scatter.largest`.
    LargestScatter,
    /// Length of the path to that surface from the camera \[m\]: `depth.Z`.
    Depth,
    /// Variance of the mean depth \[m^2\]: `depth.variance.Z`.
    DepthVariance,
    /// Expected photo-electrons: `electrons.Y`.
    Electrons,
    /// Render variance over sensor variance: `hidden.Y`.
    Hidden,
    /// Does noise-matched exposure hold, 1 or 0: `matched.Y`.
    Matched,
    /// Object id, behind smooth glass: `id.object`.
    ObjectId,
    /// Material id, likewise: `id.material`.
    MaterialId,
}

impl Triple {
    fn own(self) -> [&'static str; 3] {
        match self {
            Self::Mean => ["R", "G", "B"],
            Self::Variance => ["variance.R", "variance.G", "variance.B"],
            Self::Covariance => ["covariance.RG", "covariance.RB", "covariance.GB"],
            Self::Denoised => ["denoised.R", "denoised.G", "denoised.B"],
            Self::FirstLight => ["first_light.R", "first_light.G", "first_light.B"],
            Self::MomentX => ["moment.x.R", "moment.x.G", "moment.x.B"],
            Self::MomentY => ["moment.y.R", "moment.y.G", "moment.y.B"],
            Self::Lens => ["lens.R", "lens.G", "lens.B"],
            Self::Albedo => ["albedo.R", "albedo.G", "albedo.B"],
            Self::Normal => ["normal.X", "normal.Y", "normal.Z"],
            Self::AlbedoVariance => ["albedo.variance.R", "albedo.variance.G", "albedo.variance.B"],
            Self::NormalVariance => ["normal.variance.X", "normal.variance.Y", "normal.variance.Z"],
        }
    }

    /// Names of the layer in other programs, in lower case, the best first: Blender's `ViewLayer.Combined.R`, Mitsuba's
    /// AOVs, the conventions of Arnold and V-Ray. An empty name is a channel without layer.
    fn foreign(self) -> &'static [&'static str] {
        match self {
            // Cycles stores the rendered image beside the one that it has denoised itself.
            Self::Mean => &["noisy image", "", "combined", "beauty", "rgba", "rgb", "image", "color"],
            Self::Variance => &["variance"],
            Self::Denoised => &["denoised"],
            Self::Albedo => &["denoising albedo", "albedo", "diffcol", "diffuse_albedo", "diffuse_reflectance"],
            Self::Normal => &["denoising normal", "normal", "normals", "sh_normal", "nn", "n"],
            Self::Covariance
            | Self::FirstLight
            | Self::MomentX
            | Self::MomentY
            | Self::Lens
            | Self::AlbedoVariance
            | Self::NormalVariance => &[],
        }
    }
}

impl Single {
    fn own(self) -> &'static str {
        match self {
            Self::SampleCount => "spp.Y",
            Self::Scatter => "scatter.Y",
            Self::LargestScatter => "scatter.largest",
            Self::Depth => "depth.Z",
            Self::DepthVariance => "depth.variance.Z",
            Self::Electrons => "electrons.Y",
            Self::Hidden => "hidden.Y",
            Self::Matched => "matched.Y",
            Self::ObjectId => "id.object",
            Self::MaterialId => "id.material",
        }
    }

    fn foreign(self) -> &'static [&'static str] {
        match self {
            Self::Depth => &["denoising depth", "depth", "dd.y", "dd", "z"],
            _ => &[],
        }
    }
}

impl ExrLayers {
    /// An image without channels.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, channels: Vec::new(), attributes: String::new(), frame: None }
    }

    /// Adds a layer of triples.
    pub fn push_triples(&mut self, layer: Triple, plane: &Plane<[f32; 3]>) {
        for (component, name) in layer.own().into_iter().enumerate() {
            let samples = plane.data().iter().map(|v| v[component]).collect();
            self.channels.push((name.into(), Channel::F32(samples)));
        }
    }

    /// Adds a layer of single numbers.
    pub fn push_floats(&mut self, layer: Single, plane: Plane<f32>) {
        self.channels.push((layer.own().into(), Channel::F32(plane.into_vec())));
    }

    /// Adds a layer of whole numbers, identities and counts. A float could not store them exactly beyond 2^24.
    pub fn push_integers(&mut self, layer: Single, plane: Plane<u32>) {
        self.channels.push((layer.own().into(), Channel::U32(plane.into_vec())));
    }

    /// The samples of all channels, in their order: a strip as [`write_exr_rows`](crate::exr::write_exr_rows) requires
    /// it.
    pub fn into_samples(self) -> Vec<Channel> {
        self.channels.into_iter().map(|(_, channel)| channel).collect()
    }

    /// Adds the rows of another image with the same width and channels below its own. Channels that it does not have are left out.
    pub fn append_rows(&mut self, below: Self) {
        self.height += below.height;
        for ((_, own), (_, other)) in self.channels.iter_mut().zip(below.channels) {
            match (own, other) {
                (Channel::F32(own), Channel::F32(other)) => own.extend(other),
                (Channel::U32(own), Channel::U32(other)) => own.extend(other),
                (Channel::F32(_), Channel::U32(_)) | (Channel::U32(_), Channel::F32(_)) => {}
            }
        }
    }

    /// The channel of that exact name.
    pub fn channel(&self, name: &str) -> Option<&Channel> {
        self.channels.iter().find(|(n, _)| n == name).map(|(_, channel)| channel)
    }

    /// A layer of triples, under our name or one of those of other programs. A mean with a single grey channel is grey
    /// in all three.
    pub fn triples(&self, layer: Triple) -> Option<Plane<[f32; 3]>> {
        let own = layer.own().map(|name| self.channel(name));
        let channels = if let [Some(r), Some(g), Some(b)] = own {
            [r, g, b]
        } else {
            // X, Y and Z are the components of a vector. As light they would be those of the CIE, which are not red,
            // green and blue.
            let is_vector = matches!(layer, Triple::Normal | Triple::NormalVariance);
            layer.foreign().iter().find_map(|name| self.foreign_triple(name, is_vector))?
        };
        self.assembled(channels)
    }

    /// A layer of triples by the name before its components, or the innermost part of it, in upper or lower case:
    /// `ViewLayer.Combined` or `combined`. An empty name means the channels without layer.
    pub fn triples_named(&self, name: &str) -> Option<Plane<[f32; 3]>> {
        self.assembled(self.foreign_triple(&name.to_ascii_lowercase(), false)?)
    }

    /// A layer of single numbers, as floats.
    pub fn single(&self, layer: Single) -> Option<Plane<f32>> {
        let channel = self
            .channel(layer.own())
            .or_else(|| layer.foreign().iter().find_map(|name| self.foreign_channels(name).next().map(|c| c.1)))?;
        Plane::from_vec(self.width, self.height, floats(channel).into_owned())
    }

    /// A layer of whole numbers; `None` if a float in it is not whole or not in range.
    pub fn integers(&self, layer: Single) -> Option<Plane<u32>> {
        let data = match self.channel(layer.own())? {
            Channel::U32(v) => v.clone(),
            Channel::F32(v) => v.iter().map(|&f| is_count(f).then_some(f as u32)).collect::<Option<_>>()?,
        };
        Plane::from_vec(self.width, self.height, data)
    }

    /// The reason why a layer is not one of whole numbers: the number of such values, column and row of the first, and
    /// that value. `None` if the layer does not exist, or is one.
    pub fn singles_that_are_no_counts(&self, layer: Single) -> Option<(usize, [u32; 2], f32)> {
        let Channel::F32(values) = self.channel(layer.own())? else { return None };
        let mut wrong = values.iter().enumerate().filter(|(_, v)| !is_count(**v));
        let (first, value) = wrong.next()?;
        let width = self.width.max(1) as usize;
        Some((1 + wrong.count(), [(first % width) as u32, (first / width) as u32], *value))
    }

    /// Removes and returns a layer of triples, if it exists under our name.
    pub fn remove_triples(&mut self, layer: Triple) {
        let names = layer.own();
        self.channels.retain(|(name, _)| !names.contains(&name.as_str()));
    }

    /// Component and samples of the channels whose innermost layers have the name (in lower case).
    fn foreign_channels<'a>(&'a self, layer: &'a str) -> impl Iterator<Item = (String, &'a Channel)> {
        self.channels.iter().filter_map(move |(name, channel)| {
            let (path, component) = name.rsplit_once('.').unwrap_or(("", name));
            let path = path.to_ascii_lowercase();
            let rest = path.strip_suffix(layer)?;
            let is_whole = if layer.is_empty() { rest.is_empty() } else { rest.is_empty() || rest.ends_with('.') };
            is_whole.then(|| (component.to_ascii_uppercase(), channel))
        })
    }

    fn assembled(&self, channels: [&Channel; 3]) -> Option<Plane<[f32; 3]>> {
        let [r, g, b] = channels.map(floats);
        let data = r.iter().zip(g.iter()).zip(b.iter()).map(|((r, g), b)| [*r, *g, *b]).collect();
        Plane::from_vec(self.width, self.height, data)
    }

    fn foreign_triple<'a>(&'a self, layer: &'a str, is_vector: bool) -> Option<[&'a Channel; 3]> {
        let channels: Vec<_> = self.foreign_channels(layer).collect();
        let find = |component: &str| channels.iter().find(|(c, _)| c == component).map(|(_, channel)| *channel);
        let mut known = [["R", "G", "B"], ["X", "Y", "Z"], ["RED", "GREEN", "BLUE"], ["Y", "Y", "Y"]].into_iter();
        // One grey channel means light of all colours, unless it is the middle one of three others.
        let has_xz = find("X").is_some() && find("Z").is_some();
        known.by_ref().filter(|names| is_vector || !(has_xz && names.contains(&"Y"))).find_map(|names| {
            let [a, b, c] = names.map(find);
            Some([a?, b?, c?])
        })
    }
}

fn floats(channel: &Channel) -> std::borrow::Cow<'_, [f32]> {
    match channel {
        Channel::F32(v) => v.into(),
        Channel::U32(v) => v.iter().map(|&u| u as f32).collect::<Vec<_>>().into(),
    }
}

/// A whole number of zero or more that fits 32 bits.
fn is_count(v: f32) -> bool {
    v >= 0.0 && v < u32::MAX as f32 && v.fract() == 0.0
}
