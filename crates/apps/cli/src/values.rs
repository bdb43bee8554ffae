//! The values of flags: read from their text, and checked before any file is opened. An error contains the correct
//! form.

use dunkelfeld::io::Time;
use dunkelfeld::scene::Effect;
use dunkelfeld::trace::PixelSample;
use std::fmt::Display;
use std::ops::{Range, RangeInclusive};

/// A time such as `5ms`, in seconds.
pub(crate) fn time(text: &str) -> Result<f64, String> {
    text.parse::<Time>().map(f64::from).map_err(|e| e.to_string())
}

/// A whole number of the whole range of its type.
pub(crate) fn whole<T: TryFrom<u64>>(text: &str) -> Result<T, String> {
    let most = u64::MAX >> (64 - 8 * size_of::<T>());
    let value = text.parse::<u64>().ok().and_then(|n| T::try_from(n).ok());
    value.ok_or_else(|| format!("write a whole number from 0 to {most}"))
}

/// Reads whole numbers from the first to the last of a range.
pub(crate) fn within<T>(range: RangeInclusive<T>) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: Copy + PartialOrd + TryFrom<u64> + Display + Send + Sync + 'static,
{
    move |text| {
        let value = text.parse::<u64>().ok().and_then(|n| T::try_from(n).ok());
        let error = || format!("write a whole number from {} to {}", range.start(), range.end());
        value.filter(|value| range.contains(value)).ok_or_else(error)
    }
}

/// An address with a port. `localhost` is 127.0.0.1; no other name is looked up.
#[cfg(feature = "view")]
pub(crate) fn socket_address(text: &str) -> Result<std::net::SocketAddr, String> {
    let loopback = |port: &str| Some((std::net::Ipv4Addr::LOCALHOST, port.parse::<u16>().ok()?).into());
    let address = text.parse().ok().or_else(|| text.strip_prefix("localhost:").and_then(loopback));
    address.ok_or_else(|| "write an IP address with a port, as in 0.0.0.0:8080 or [::1]:8080".to_owned())
}

/// A time of zero or more, in seconds.
pub(crate) fn pause(text: &str) -> Result<f64, String> {
    match time(text)? {
        t if t >= 0.0 && t.is_finite() => Ok(t),
        _ => Err("write a time of zero or more, such as 30s".into()),
    }
}

pub(crate) fn time_limit(text: &str) -> Result<f64, String> {
    match time(text)? {
        t if t > 0.0 && t.is_finite() => Ok(t),
        _ => Err("write a time above zero, such as 20s".into()),
    }
}

pub(crate) fn effect(name: &str) -> Result<Effect, String> {
    Effect::ALL.into_iter().find(|e| e.name() == name).ok_or_else(|| {
        let names: Vec<&str> = dunkelfeld::commands::removable_effects().iter().map(|e| e.name()).collect();
        format!("write one of {}", names.join(", "))
    })
}

pub(crate) fn sample_range(text: &str) -> Result<Range<u32>, String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    match ends {
        Some((first, end)) if first < end && end <= dunkelfeld::adaptive::MAX_SPP => Ok(first..end),
        _ => Err(format!(
            "write two whole numbers, the second one larger and at most {}: 0..64 are the first 64 samples, 64..128 the next",
            dunkelfeld::adaptive::MAX_SPP
        )),
    }
}

pub(crate) fn pixel_sample(text: &str) -> Result<PixelSample, String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|t| t.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, index]) => Ok(PixelSample { x, y, index }),
        _ => Err("write column, row and number of the sample, as in 12,40,7".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dunkelfeld::scene::SceneBuilder;

    #[test]
    fn listed_effects_are_the_ones_that_can_be_left_out() {
        let list = effect("foo").expect_err("no effect has this name");
        for e in Effect::ALL {
            let listed = list.replace("write one of ", "").split(", ").any(|name| name == e.name());
            assert_eq!(listed, SceneBuilder::default().leave_out(e), "{}: {list}", e.name());
        }
    }

    #[cfg(feature = "view")]
    #[test]
    fn addresses_have_a_port() {
        assert_eq!(socket_address("localhost:80"), socket_address("127.0.0.1:80"));
        assert!(socket_address("[::1]:8080").is_ok() && socket_address("0.0.0.0:0").is_ok());
        for bad in ["localhost", "localhost:", "localhost:70000", "127.0.0.1", "::1:80", "example.org:80", ""] {
            assert!(socket_address(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn values_are_checked_before_any_file_is_opened() {
        assert_eq!(time_limit("2min"), Ok(120.0));
        for bad in ["0s", "-1s", "20x", "soon", "nan s", "inf", ""] {
            assert!(time_limit(bad).is_err(), "{bad}");
        }
        assert_eq!((pause("0s"), pause("2min")), (Ok(0.0), Ok(120.0)));
        for bad in ["-1s", "inf", "nan s", "x", ""] {
            assert!(pause(bad).is_err(), "{bad}");
        }
        assert_eq!((whole::<u64>("18446744073709551615"), whole::<u32>("7")), (Ok(u64::MAX), Ok(7)));
        for bad in ["-1", "1.5", "x", "", "4294967296"] {
            assert_eq!(whole::<u32>(bad), Err("write a whole number from 0 to 4294967295".into()), "{bad}");
        }
        let side = within(1..=32_768u32);
        assert_eq!((side("1"), side("32768")), (Ok(1), Ok(32_768)));
        for bad in ["0", "32769", "-3", "1.0", "", "99999999999999999999"] {
            assert_eq!(side(bad), Err("write a whole number from 1 to 32768".into()), "{bad}");
        }
        assert_eq!(pixel_sample("12, 40,7"), Ok(PixelSample { x: 12, y: 40, index: 7 }));
        for bad in ["12,40", "12,40,7,1", "a,b,c", "-1,0,0", ""] {
            assert!(pixel_sample(bad).is_err(), "{bad}");
        }
        assert_eq!(sample_range("64..128"), Ok(64..128));
        for bad in ["64", "64..", "..64", "64..64", "5..4", "-1..4", "a..b", "0..4294967296", "0..1e3", "0...4", ""] {
            assert!(sample_range(bad).is_err(), "{bad}");
        }
    }
}
