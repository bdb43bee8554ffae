//! The end of a run as a date, a time of day, or both.

use dunkelfeld::Error;
use jiff::civil::{Date, Time};
use jiff::fmt::temporal::{DateTimeParser, Pieces};
use jiff::tz::{AmbiguousOffset, Offset, TimeZone};
use jiff::{SignedDuration, Timestamp, Zoned};
use std::fmt;

/// The forms of a deadline.
const HELP: &str = "write a time of day such as 8:00 or \"tomorrow 8:00\", or a date such as \"2030-01-31 8:00\" or 2030-01-31T08:00; the time is that of this computer, or of a zone behind it, as in \"8:00 Europe/Berlin\", \"8:00 +01:00\" and 2030-01-31T08:00Z";

/// The time at which a run shall end.
#[derive(Clone, Debug, PartialEq)]
pub struct Deadline(Zoned);

impl Deadline {
    /// Reads a deadline. `8:00` is the next time at which a clock shows it, today or tomorrow; `tomorrow 8:00` is a day later
    /// than today in any case. A date is `2030-01-31 8:00` or `2030-01-31T08:00`. A zone may follow: a name such as
    /// `Europe/Berlin`, an offset such as `+01:00`, or `Z`. Without one, the zone is that of the computer.
    ///
    /// # Errors
    /// Another form, an unknown zone, a time in the past.
    pub fn parse(text: &str) -> Result<Self, Error> {
        Self::parse_at(text, &Zoned::now())
    }

    fn parse_at(text: &str, now: &Zoned) -> Result<Self, Error> {
        let at = read(text, now).map_err(|problem| Error::setting("until", problem, HELP))?;
        Self(at).checked(now)
    }

    /// The deadline at a time in seconds since 1970-01-01 00:00 UTC, in the zone of the computer.
    ///
    /// # Errors
    /// A time in the past, or outside of the years -9999 to 9999.
    pub fn at_unix_time(seconds: f64) -> Result<Self, Error> {
        let at = SignedDuration::try_from_secs_f64(seconds)
            .and_then(Timestamp::from_duration)
            .map_err(|_| Error::setting("until", format!("{seconds} s is no date of the years -9999 to 9999"), HELP))?;
        Self(at.to_zoned(TimeZone::system())).checked(&Zoned::now())
    }

    /// A time that comes in `seconds`, in the zone of the computer. `None` if it is too late for a date.
    pub fn in_seconds(seconds: f64) -> Option<Self> {
        let later = SignedDuration::try_from_secs_f64(seconds).ok()?;
        Zoned::now().checked_add(later).ok().map(Self)
    }

    fn checked(self, now: &Zoned) -> Result<Self, Error> {
        if self.0.timestamp() > now.timestamp() {
            return Ok(self);
        }
        let problem = format!("{self} is over: it is {}", Self(now.clone()));
        Err(Error::setting("until", problem, "write a later time, or a duration with --time"))
    }

    /// Seconds from now to the deadline.
    ///
    /// # Errors
    /// It is over.
    pub fn seconds_left(&self) -> Result<f64, Error> {
        let now = Zoned::now();
        let Self(at) = self.clone().checked(&now)?;
        Ok(at.timestamp().duration_since(now.timestamp()).as_secs_f64())
    }
}

/// The date, the time of day and the zone, to the second.
impl fmt::Display for Deadline {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(at) = self;
        let date_and_time = at.strftime("%Y-%m-%d %H:%M:%S %:z");
        match at.time_zone().iana_name() {
            Some(name) => write!(f, "{date_and_time} ({name})"),
            None => write!(f, "{date_and_time}"),
        }
    }
}

/// Reads `[DATE|tomorrow] TIME [ZONE]`, or a date and a time of RFC 3339 or RFC 9557.
fn read(text: &str, now: &Zoned) -> Result<Zoned, String> {
    let text = text.trim();
    let far = || format!("{text:?}: no zone is more than 14 hours from UTC");
    let pieces = Pieces::parse(text).ok();
    if pieces.as_ref().and_then(Pieces::to_numeric_offset).is_some_and(is_far) {
        return Err(far());
    }
    if let Ok(at) = text.parse::<Zoned>() {
        let written = pieces.as_ref().and_then(|p| Some(p.date().to_datetime(p.time()?)));
        return if written.is_some_and(|written| written != at.datetime()) { Err(gap(text)) } else { Ok(at) };
    }
    if let Ok(at) = text.parse::<Timestamp>() {
        return Ok(at.to_zoned(now.time_zone().clone()));
    }
    let no_form = || format!("{text:?} is no time");
    let mut words: Vec<&str> = text.split_whitespace().collect();
    // A date and a time may be one word.
    if let Some((date, time)) = words.first().copied().and_then(|word| word.split_once('T'))
        && date.starts_with(|c: char| c.is_ascii_digit())
    {
        words.splice(..1, [date, time]);
    }
    let is_day = |word: &&str| *word == "tomorrow" || !word.contains(':');
    let day = words.first().copied().filter(is_day);
    let mut rest = words.into_iter().skip(usize::from(day.is_some()));
    let time = rest.next().and_then(time_of_day).ok_or_else(no_form)?;
    let zone = match rest.next() {
        None => now.time_zone().clone(),
        Some("Z") => TimeZone::UTC,
        Some(name) => {
            let parsed = DateTimeParser::new().parse_time_zone(name);
            parsed.map_err(|_| format!("{text:?}: {name:?} is no known time zone"))?
        }
    };
    if zone.to_fixed_offset().is_ok_and(is_far) {
        return Err(far());
    }
    if rest.next().is_some() {
        return Err(no_form());
    }
    let now = now.with_time_zone(zone.clone());
    let at = |date: Date| {
        let found = zone.to_ambiguous_zoned(date.to_datetime(time));
        if matches!(found.offset(), AmbiguousOffset::Gap { .. }) {
            return Err(gap(text));
        }
        // Of a time that comes twice, when clocks are put back, the first one.
        found.compatible().map_err(|_| too_late(text))
    };
    let tomorrow = || now.date().tomorrow().map_err(|_| too_late(text)).and_then(at);
    match day {
        Some("tomorrow") => tomorrow(),
        Some(date) => at(Date::strptime("%Y-%m-%d", date).map_err(|_| no_form())?),
        None => {
            let today = at(now.date()).ok().filter(|today| today.timestamp() > now.timestamp());
            today.map_or_else(tomorrow, Ok)
        }
    }
}

/// The problem of a time that clocks skip.
fn gap(text: &str) -> String {
    format!("{text:?}: clocks are put forward at that time, and do not show it")
}

/// The problem of a time beyond those that can be computed.
fn too_late(text: &str) -> String {
    format!("{text:?} is beyond the last date, at the end of the year 9999 in UTC")
}

/// Is an offset larger than that of any zone?
fn is_far(offset: Offset) -> bool {
    offset.seconds().abs() > 14 * 3600
}

fn time_of_day(word: &str) -> Option<Time> {
    Time::strptime("%H:%M", word).or_else(|_| Time::strptime("%H:%M:%S", word)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Friday in winter, at half past nine in the evening.
    fn evening() -> Zoned {
        "2030-02-01T21:30[Europe/Berlin]".parse().expect("a date")
    }

    fn read_at(text: &str) -> String {
        Deadline::parse_at(text, &evening()).map_or_else(|e| format!("error: {e}"), |deadline| deadline.to_string())
    }

    #[test]
    fn a_time_of_day_is_the_next_one() {
        let tomorrow = "2030-02-02 08:00:00 +01:00 (Europe/Berlin)";
        for text in ["8:00", "08:00", "8:00:00", " 08:00 ", "tomorrow 8:00", "2030-02-02 8:00", "2030-02-02T08:00"] {
            assert_eq!(read_at(text), tomorrow, "{text}");
        }
        assert_eq!(read_at("21:31"), "2030-02-01 21:31:00 +01:00 (Europe/Berlin)");
        // The present minute is over.
        assert_eq!(read_at("21:30"), "2030-02-02 21:30:00 +01:00 (Europe/Berlin)");
        assert_eq!(read_at("tomorrow 21:31"), "2030-02-02 21:31:00 +01:00 (Europe/Berlin)");
    }

    #[test]
    fn a_zone_may_follow() {
        assert_eq!(read_at("23:00 UTC"), "2030-02-01 23:00:00 +00:00 (UTC)");
        // It is half past five in Tokyo, of the next day.
        assert_eq!(read_at("8:00 Asia/Tokyo"), "2030-02-02 08:00:00 +09:00 (Asia/Tokyo)");
        assert_eq!(read_at("8:00 -05:00"), "2030-02-02 08:00:00 -05:00");
        assert_eq!(read_at("2030-07-01 8:00 Europe/Berlin"), "2030-07-01 08:00:00 +02:00 (Europe/Berlin)");
        assert_eq!(read_at("2030-07-01T08:00[Asia/Tokyo]"), "2030-07-01 08:00:00 +09:00 (Asia/Tokyo)");
        // An instant is shown in the zone of the computer.
        assert_eq!(read_at("2030-02-02T08:00Z"), "2030-02-02 09:00:00 +01:00 (Europe/Berlin)");
    }

    /// Clocks go from 02:00 to 03:00 on 2030-03-31 in Berlin, so that this night has an hour less.
    #[test]
    fn a_night_with_a_change_of_the_clocks_has_its_true_length() {
        let before: Zoned = "2030-03-30T20:00[Europe/Berlin]".parse().expect("a date");
        let Deadline(at) = Deadline::parse_at("8:00", &before).expect("a time");
        assert_eq!(at.timestamp().duration_since(before.timestamp()).as_secs(), 11 * 3600);
    }

    #[test]
    fn a_time_that_clocks_skip_and_a_zone_that_no_place_has_are_refused() {
        for text in ["2030-03-31 2:30", "2030-03-31T02:30[Europe/Berlin]", "2030-03-31 2:30 Europe/Berlin"] {
            assert!(read_at(text).contains("clocks are put forward"), "{text}: {}", read_at(text));
        }
        // A time that comes twice is the first one.
        assert_eq!(read_at("2030-10-27 2:30"), "2030-10-27 02:30:00 +02:00 (Europe/Berlin)");
        for text in ["8:00 +25:00", "8:00 -14:30", "2030-03-31T08:00+25:00", "2030-03-31 8:00 +15:00"] {
            assert!(read_at(text).contains("more than 14 hours"), "{text}: {}", read_at(text));
        }
        assert!(read_at("8:00 +14:00").starts_with("2030"), "{}", read_at("8:00 +14:00"));
    }

    #[test]
    fn other_texts_are_refused_with_help() {
        for text in
            ["", "soon", "8", "8h", "25:00", "8:61", "tomorrow", "2030-02-30 8:00", "2030-02-03", "8:00 8:00 UTC"]
        {
            let message = read_at(text);
            assert!(message.starts_with("error:") && message.contains("8:00"), "{text}: {message}");
        }
        assert!(read_at("8:00 Europe/Atlantis").contains("\"Europe/Atlantis\" is no known time zone"));
        for text in ["9999-12-31 23:00 UTC", "9999-12-31 8:00 -12:00"] {
            let message = read_at(text);
            assert!(message.contains("is beyond the last date") && !message.contains("jiff"), "{text}: {message}");
        }
        for text in ["2030-02-01 21:29", "2029-12-31T08:00", "2030-02-01T20:30Z", "2030-02-01T21:30 Europe/Berlin"] {
            assert!(read_at(text).contains("is over: it is 2030-02-01 21:30:00 +01:00"), "{text}: {}", read_at(text));
        }
        assert!(Deadline::at_unix_time(0.0).is_err() && Deadline::at_unix_time(f64::NAN).is_err());
        assert!(Deadline::at_unix_time(4e9).is_ok_and(|deadline| deadline.seconds_left().is_ok_and(|s| s > 1e8)));
    }
}
