//! The sensors of the program, as the text of their files.
//!
//! The text has the format of user files. `dunkelfeld-io` reads both.

/// Name and TOML text of every preset.
pub const PRESETS: [(&str, &str); 8] = [
    ("imx174", include_str!("../presets/imx174.toml")),
    ("imx174-pointgrey", include_str!("../presets/imx174-pointgrey.toml")),
    ("imx178-color", include_str!("../presets/imx178-color.toml")),
    ("imx183", include_str!("../presets/imx183.toml")),
    ("imx250", include_str!("../presets/imx250.toml")),
    ("imx492", include_str!("../presets/imx492.toml")),
    ("imx900-hcg", include_str!("../presets/imx900-hcg.toml")),
    ("imx900-lcg", include_str!("../presets/imx900-lcg.toml")),
];
