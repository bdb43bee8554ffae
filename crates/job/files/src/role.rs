//! The uses of input files, for messages.

/// The use of an input file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// The scene file.
    Scene,
    /// An image of the scene.
    Texture,
    /// A buffer of a glTF scene.
    Buffer,
    /// A material library (MTL) of an OBJ scene.
    MaterialLibrary,
    /// A light distribution (IES).
    LightProfile,
    /// The image of the environment.
    Environment,
    /// The job.
    Job,
    /// A sensor file.
    Sensor,
    /// A map of the pixels of a sensor.
    PixelMap,
    /// The MTF of a lens.
    Mtf,
    /// The plan that is replayed.
    Plan,
    /// A checkpoint that the run itself does not write.
    Checkpoint,
    /// A part that is merged.
    Part,
    /// An EXR that is denoised or exposed.
    Image,
    /// The descriptor of an EMVA 1288 data set.
    Descriptor,
    /// A frame of grey values.
    Frame,
    /// A file of a results folder.
    Result,
    /// A shared library that is loaded.
    Library,
    /// A file with data of the system about the process.
    Report,
}

impl Role {
    /// All uses.
    pub const ALL: [Self; 19] = [
        Self::Scene,
        Self::Texture,
        Self::Buffer,
        Self::MaterialLibrary,
        Self::LightProfile,
        Self::Environment,
        Self::Job,
        Self::Sensor,
        Self::PixelMap,
        Self::Mtf,
        Self::Plan,
        Self::Checkpoint,
        Self::Part,
        Self::Image,
        Self::Descriptor,
        Self::Frame,
        Self::Result,
        Self::Library,
        Self::Report,
    ];

    /// With article, for messages: `a texture`, `the scene`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene => "the scene",
            Self::Texture => "a texture",
            Self::Buffer => "a buffer",
            Self::MaterialLibrary => "a material library",
            Self::LightProfile => "a light profile",
            Self::Environment => "the environment image",
            Self::Job => "the job",
            Self::Sensor => "the sensor file",
            Self::PixelMap => "a map of the sensor",
            Self::Mtf => "the MTF of the lens",
            Self::Plan => "the plan to replay",
            Self::Checkpoint => "a checkpoint",
            Self::Part => "a part",
            Self::Image => "the input image",
            Self::Descriptor => "the data set's descriptor",
            Self::Frame => "a frame",
            Self::Result => "a result",
            Self::Library => "the denoiser's library",
            Self::Report => "a report of the system",
        }
    }
}
