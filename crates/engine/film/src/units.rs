//! Units and limits of the sums, as powers of two.

/// One unit of a sum of radiances is 2^-RADIANCE_BITS W/(m^2 sr).
pub const RADIANCE_BITS: i32 = 48;
/// Samples with a radiance of 2^RADIANCE_LIMIT_BITS W/(m^2 sr) or more are invalid.
pub const RADIANCE_LIMIT_BITS: i32 = 46;
/// One unit of the sums of albedo and normal is 2^-UNIT_BITS, as fine as a 32-bit float below one.
pub const UNIT_BITS: i32 = 24;
/// One unit of the sums of their squares is 2^-UNIT_SQUARE_BITS.
pub const UNIT_SQUARE_BITS: i32 = 30;
/// One unit of the sum of depths is 2^-DEPTH_BITS m, one of their squares 2^-(2 DEPTH_BITS) m^2.
pub const DEPTH_BITS: i32 = 24;
/// Depths above 2^DEPTH_LIMIT_BITS m count as this depth.
pub const DEPTH_LIMIT_BITS: i32 = 31;
/// One unit of the sum of the squares of luminance is 2^-SQUARE_BITS (W/(m^2 sr))^2: a luminance of 1e-9 W/(m^2 sr) keeps
/// twenty bits of its square, and 2^32 squares of the largest valid one stay below 2^(124 + 80).
pub const SQUARE_BITS: i32 = 80;
