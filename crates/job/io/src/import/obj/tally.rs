//! Counts equal faults, so that a file with ten thousand of them gives one readable warning.

use crate::import::warnings::Warnings;

/// Maximum number of line numbers in a warning.
const SHOWN: usize = 5;

/// Faults of one file: message, first lines and number, in order of first occurrence.
#[derive(Debug, Default)]
pub(super) struct Tally(Vec<(&'static str, Vec<u32>, usize)>);

impl Tally {
    /// Records a fault on a line.
    pub(super) fn add(&mut self, line: u32, message: &'static str) {
        let known = self.0.iter().position(|kind| kind.0 == message);
        let index = known.unwrap_or_else(|| {
            self.0.push((message, Vec::new(), 0));
            self.0.len() - 1
        });
        let (_, lines, count) = &mut self.0[index];
        *count += 1;
        // Several faults on one line are reported once.
        if lines.len() < SHOWN && lines.last() != Some(&line) {
            lines.push(line);
        }
    }

    /// Reports the faults.
    pub(super) fn report(self, warnings: &mut Warnings) {
        for (message, lines, count) in self.0 {
            let numbers = lines.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
            let lines_word = if count == 1 { "line" } else { "lines" };
            let more = match count - lines.len() {
                0 => String::new(),
                more => format!(" and {more} more times"),
            };
            warnings.push(format!("{lines_word} {numbers}{more}"), message);
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
        let mut warnings = Warnings::new(Path::new("folder/a.obj"));
        tally.report(&mut warnings);
        let text: Vec<String> = warnings.finish().iter().map(ToString::to_string).collect();
        assert_eq!(text, ["a.obj: line 3: odd", "a.obj: lines 10, 11, 12, 13, 14 and 25 more times: dropped"]);
    }
}
