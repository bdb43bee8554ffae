//! Units as types, for the borders between crates.
//!
//! Each is a named number. Inside a crate, formulas use the number itself. Conversions are explicit functions.

use std::fmt;
use std::ops::{Add, Div, Mul, Sub};

macro_rules! unit {
    ($(#[$doc:meta])* $name:ident, $symbol:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, serde::Serialize, serde::Deserialize)]
        pub struct $name(pub f64);

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                fmt::Display::fmt(&self.0, f)?;
                f.write_str(concat!(" ", $symbol))
            }
        }

        impl Add for $name {
            type Output = Self;
            fn add(self, o: Self) -> Self {
                Self(self.0 + o.0)
            }
        }

        impl Sub for $name {
            type Output = Self;
            fn sub(self, o: Self) -> Self {
                Self(self.0 - o.0)
            }
        }

        impl Mul<f64> for $name {
            type Output = Self;
            fn mul(self, s: f64) -> Self {
                Self(self.0 * s)
            }
        }

        impl Div<f64> for $name {
            type Output = Self;
            fn div(self, s: f64) -> Self {
                Self(self.0 / s)
            }
        }

        impl Div for $name {
            type Output = f64;
            fn div(self, o: Self) -> f64 {
                self.0 / o.0
            }
        }
    };
}

unit!(
    /// Length \[m\].
    Metres,
    "m"
);
unit!(
    /// Time \[s\].
    Seconds,
    "s"
);
unit!(
    /// Wavelength in vacuum \[nm\].
    Nanometres,
    "nm"
);
unit!(
    /// Power per area and solid angle [W/(m^2 sr)].
    Radiance,
    "W/(m^2 sr)"
);
unit!(
    /// Power per area [W/m^2].
    Irradiance,
    "W/m^2"
);
unit!(
    /// A number of electrons, or its expected value \[e-\].
    Electrons,
    "e-"
);
unit!(
    /// A grey value of the camera \[DN\].
    DigitalNumber,
    "DN"
);
unit!(
    /// Temperature \[degrees Celsius\].
    Celsius,
    "degC"
);

impl Metres {
    /// A length given in micrometres, as pixel pitches are.
    pub const fn from_micrometres(um: f64) -> Self {
        Self(um * 1e-6)
    }

    /// The length in micrometres.
    pub const fn micrometres(self) -> f64 {
        self.0 * 1e6
    }
}

impl Nanometres {
    /// The wavelength as a length.
    pub const fn metres(self) -> Metres {
        Metres(self.0 * 1e-9)
    }
}
