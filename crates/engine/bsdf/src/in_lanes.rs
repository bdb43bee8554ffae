//! Compiled parameters with a number per lane.

use dunkelfeld_lanes::{Lanes, MAX_WIDTH};
use dunkelfeld_radiometry::Rgb;

/// Compiled parameters of one surface that can be loaded into lanes. The parameters stay borrowed, because the curves of
/// a surface are read where they are.
pub trait InLanes<F: Lanes> {
    /// The parameters per lane.
    type Lanes<'a>
    where
        Self: 'a;

    /// The parameters `of(lane)` in each lane.
    fn collect<'a>(token: F::Token, of: impl Fn(usize) -> &'a Self + Copy) -> Self::Lanes<'a>;

    /// The same parameters in all lanes.
    #[inline(always)]
    fn splat(token: F::Token, all: &Self) -> Self::Lanes<'_> {
        Self::collect(
            token,
            #[inline(always)]
            |_| all,
        )
    }

    /// The parameters of each lane. Entries beyond the last lane are not used.
    #[inline(always)]
    fn gather<'a>(token: F::Token, lanes: &[&'a Self; MAX_WIDTH]) -> Self::Lanes<'a> {
        Self::collect(
            token,
            #[inline(always)]
            |lane| lanes[lane],
        )
    }
}

impl<F: Lanes> InLanes<F> for f32 {
    type Lanes<'a> = F;
    #[inline(always)]
    fn collect<'a>(token: F::Token, of: impl Fn(usize) -> &'a Self + Copy) -> F {
        let mut lanes = [0.0; MAX_WIDTH];
        for (lane, number) in lanes.iter_mut().enumerate().take(F::WIDTH) {
            *number = *of(lane);
        }
        F::load(token, &lanes)
    }
}

/// True in lanes if it is true in one of them.
impl<F: Lanes> InLanes<F> for bool {
    type Lanes<'a> = bool;
    #[inline(always)]
    fn collect<'a>(_: F::Token, of: impl Fn(usize) -> &'a Self + Copy) -> bool {
        let mut any = false;
        for lane in 0..F::WIDTH {
            any |= *of(lane);
        }
        any
    }
}

/// Implements [`InLanes`] for a structure, by the names of its fields.
macro_rules! in_lanes {
    ($name:ty => $lanes:ty { $($field:ident),* }) => {
        impl<F: dunkelfeld_lanes::Lanes> $crate::InLanes<F> for $name {
            type Lanes<'a> = $lanes;
            #[inline(always)]
            fn collect<'a>(token: F::Token, of: impl Fn(usize) -> &'a Self + Copy) -> Self::Lanes<'a> {
                Self::Lanes {
                    $($field: $crate::InLanes::<F>::collect(token, #[inline(always)] |lane| &of(lane).$field)),*
                }
            }
        }
    };
}
pub(crate) use in_lanes;

in_lanes!(Rgb => Rgb<F> { r, g, b });
