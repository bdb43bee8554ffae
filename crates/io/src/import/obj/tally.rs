//! Counts equal faults, so that a file with ten thousand of them gives one readable warning.

use crate::import::warnings::Warnings;

/// Maximum number of line numbers in a warning.
const SHOWN: usize = 5;

/// Faults of one file, by message.
#[derive(Debug, Default)]
pub(super) struct Tally {
    /// In order of first occurrence. A file has few kinds of faults, so a search through a list is enough.
    kinds: Vec<Kind>,
}

#[derive(Debug)]
struct Kind {
    message: String,
    lines: Vec<u32>,
    count: usize,
}

impl Tally {
    /// Maximum number of separate kinds. Each unknown statement is a separate kind, and random data would give
    /// thousands.
    const MOST: usize = 100;

    /// Records a fault on a line.
    pub(super) fn add(&mut self, line: u32, message: &str) {
        let place = self.kinds.iter().position(|k| k.message == message);
        let kind = match place {
            Some(i) => &mut self.kinds[i],
            None if self.kinds.len() >= Self::MOST => return self.overflow(),
            None => {
                self.kinds.push(Kind { message: message.to_string(), lines: Vec::new(), count: 0 });
                let last = self.kinds.len() - 1;
                &mut self.kinds[last]
            }
        };
        kind.count += 1;
        // Several faults on one line are reported once.
        if kind.lines.len() < SHOWN && kind.lines.last() != Some(&line) {
            kind.lines.push(line);
        }
    }

    /// Records a fault of the file as a whole.
    pub(super) fn note(&mut self, message: &str) {
        if self.kinds.len() < Self::MOST && !self.kinds.iter().any(|k| k.message == message) {
            self.kinds.push(Kind { message: message.to_string(), lines: Vec::new(), count: 1 });
        }
    }

    /// Adds the faults of another tally after its own.
    pub(super) fn append(&mut self, later: Self) {
        for kind in later.kinds {
            // Counts without a line follow those with one.
            let unlisted = kind.count.saturating_sub(kind.lines.len());
            kind.lines.iter().for_each(|line| self.add(*line, &kind.message));
            if let Some(own) = self.kinds.iter_mut().find(|k| k.message == kind.message) {
                own.count += unlisted;
            }
        }
    }

    fn overflow(&mut self) {
        if let Some(last) = self.kinds.last_mut() {
            last.count += 1;
        }
    }

    /// Reports the faults; `name` is the name of the file if the warnings are about another one, or empty.
    pub(super) fn report(self, name: &str, warnings: &mut Warnings) {
        for kind in self.kinds {
            let numbers: Vec<String> = kind.lines.iter().map(u32::to_string).collect();
            let more = kind.count.saturating_sub(numbers.len());
            let place = match (numbers.len(), more) {
                (0, _) => "the file".to_string(),
                (1, 0) => format!("line {}", numbers[0]),
                (_, 0) => format!("lines {}", numbers.join(", ")),
                _ => format!("lines {} and {more} more times", numbers.join(", ")),
            };
            let place = if name.is_empty() { place } else { format!("{name}, {place}") };
            warnings.push(place, kind.message);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn equal_faults_are_counted_and_the_first_lines_listed() {
        let mut tally = Tally::default();
        tally.add(3, "odd");
        (10..40).for_each(|line| tally.add(line, "dropped"));
        tally.note("converted");
        let mut warnings = Warnings::new(Path::new("folder/a.obj"));
        tally.report("", &mut warnings);
        let text: Vec<String> = warnings.finish().iter().map(ToString::to_string).collect();
        assert_eq!(
            text,
            [
                "a.obj: line 3: odd",
                "a.obj: lines 10, 11, 12, 13, 14 and 25 more times: dropped",
                "a.obj: the file: converted"
            ]
        );
    }

    #[test]
    fn noise_does_not_grow_without_bound() {
        let mut tally = Tally::default();
        (0..100_000).for_each(|line| tally.add(line, &format!("kind {line}")));
        assert_eq!(tally.kinds.len(), Tally::MOST);
    }
}
