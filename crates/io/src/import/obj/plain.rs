//! Detects lines that `tobj` can read as they are. Most lines of a mesh are such. They are not copied.

/// Numbers of positions, texture coordinates and normals, in the order in which a corner of a face names them.
pub(super) type Counts = [u32; 3];

/// The numbers of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Numbers {
    /// Their number.
    pub count: usize,
    /// Is one of them at least 1e-20 in magnitude?
    pub nonzero: bool,
}

/// Detects plain decimal numbers: at most `digits` digits before the point, 20 after it, and no exponent but a negative
/// one of two digits. `None` if the line contains any other text, usable or not.
pub(super) fn numbers(data: &str, digits: usize) -> Option<Numbers> {
    let data = data.as_bytes();
    let mut numbers = Numbers { count: 0, nonzero: false };
    let mut at = 0;
    loop {
        at += spaces(data, at);
        if at == data.len() {
            return Some(numbers);
        }
        at += usize::from(data.get(at) == Some(&b'-'));
        let (whole, mut nonzero) = run_of_digits(data, at);
        at += whole;
        let mut fraction = 0;
        if data.get(at) == Some(&b'.') {
            let (count, set) = run_of_digits(data, at + 1);
            at += 1 + count;
            nonzero |= set;
            fraction = count;
        }
        if whole > digits || fraction > 20 || whole + fraction == 0 {
            return None;
        }
        if matches!(data.get(at), Some(b'e' | b'E')) && data.get(at + 1) == Some(&b'-') {
            let (exponent, _) = run_of_digits(data, at + 2);
            if !(1..=2).contains(&exponent) {
                return None;
            }
            at += 2 + exponent;
            nonzero = false;
        }
        if data.get(at).is_some_and(|b| !is_space(*b)) {
            return None;
        }
        numbers.count += 1;
        numbers.nonzero |= nonzero;
    }
}

/// Detects a face whose corners all have the same fields as the file has lists (`v`, `v/t`, `v//n` or `v/t/n`), with
/// indices in range. `seen` is the number of entries before the line, to which negative indices refer. `total` is the
/// number in the file. Returns the number of corners; `None` for any other line.
pub(super) fn face(data: &str, seen: &Counts, total: &Counts) -> Option<usize> {
    let data = data.as_bytes();
    let mut corners = 0;
    let mut at = 0;
    loop {
        at += spaces(data, at);
        if at == data.len() {
            return Some(corners);
        }
        for field in 0..3 {
            let negative = data.get(at) == Some(&b'-');
            at += usize::from(negative);
            let first = at;
            let mut index = 0_u64;
            while let Some(digit) = data.get(at).map(|b| b.wrapping_sub(b'0')).filter(|d| *d < 10) {
                index = index.wrapping_mul(10).wrapping_add(u64::from(digit));
                at += 1;
            }
            let most = if negative { seen[field] } else { total[field] };
            let is_there = at > first;
            let in_range = (1..=u64::from(most)).contains(&index) && at - first <= 10;
            if (is_there && !in_range) || is_there != (total[field] > 0) || (negative && !is_there) {
                return None;
            }
            match data.get(at) {
                Some(b'/') if field < 2 => at += 1,
                Some(b) if !is_space(*b) => return None,
                // Fields may be left out only if their lists are empty.
                _ if total[field + 1..].iter().any(|n| *n > 0) => return None,
                _ => break,
            }
        }
        corners += 1;
    }
}

fn spaces(data: &[u8], from: usize) -> usize {
    data.iter().skip(from).take_while(|b| is_space(**b)).count()
}

/// Length of the run of digits at `from`, and whether one of them is not 0.
fn run_of_digits(data: &[u8], from: usize) -> (usize, bool) {
    let mut nonzero = false;
    let digits = data.iter().skip(from).take_while(|b| b.is_ascii_digit());
    (digits.inspect(|b| nonzero |= **b != b'0').count(), nonzero)
}

/// The ASCII characters that [`char::is_whitespace`] accepts.
fn is_space(b: u8) -> bool {
    matches!(b, b'\t'..=b'\r' | b' ')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_numbers_are_distinguished_from_others() {
        let count = |text| numbers(text, 6).map(|n| (n.count, n.nonzero));
        assert_eq!(count("1 -2.5\t.5 3. 1e-05\r\n"), Some((5, true)));
        assert_eq!(count("0 -0.000 0e-9"), Some((3, false)));
        assert_eq!(count("1e-30 0 0"), Some((3, false)));
        assert_eq!(count(""), Some((0, false)));
        for text in ["1234567", "1e5", "1e-100", "+1", "1,5", "nan", "-", ".", "1..2", "1 # c", "1é", "1e-"] {
            assert_eq!(numbers(text, 6), None, "{text}");
        }
    }

    #[test]
    fn plain_faces_are_distinguished_from_others() {
        let (seen, total) = ([4, 2, 1], [9, 3, 2]);
        assert_eq!(face(" 1/1/1 9/3/2\t-4/-2/-1 \r\n", &seen, &total), Some(3));
        for text in [
            "0/1/1",
            "10/1/1",
            "1/4/1",
            "1/1/3",
            "-5/1/1",
            "-0/1/1",
            "1/1",
            "1//1",
            "1",
            "/1/1",
            "1/1/1/1",
            "1/1/1#",
            "-/1/1",
            "+1/1/1",
            "00000000001/1/1",
            "99999999999999999999/1/1",
            "1/1/x",
            "1/1/1 \\",
        ] {
            assert_eq!(face(text, &seen, &total), None, "{text}");
        }
        assert_eq!(face("1//2 2//1", &seen, &[9, 0, 2]), Some(2));
        assert_eq!(face("1/ 2 3//", &seen, &[9, 0, 0]), Some(3));
        assert_eq!(face("1/1", &seen, &[9, 0, 0]), None);
    }
}
