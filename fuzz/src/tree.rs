//! Mutations of structured data that a fuzzer's bytes choose: values of a JSON document, numbers of a buffer.

use libfuzzer_sys::arbitrary::{Result, Unstructured};
use serde_json::{Number, Value};

/// More mutations than this are not made of one input.
const MOST: usize = 24;
/// A document does not grow beyond this many values.
const MAX_VALUES: usize = 4000;

/// Numbers at the edges of types and ranges.
const EXTREMES: &[f64] = &[
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    2.0,
    255.0,
    256.0,
    65_535.0,
    65_536.0,
    2_147_483_647.0,
    -2_147_483_648.0,
    4_294_967_295.0,
    4_294_967_296.0,
    9_007_199_254_740_992.0,
    1.844_674_407_370_955_2e19,
    1e30,
    -1e30,
    1e38,
    3.5e38,
    1e300,
    -1e300,
    1e-30,
    1e-38,
    1e-45,
    1e-300,
    5e-324,
    0.999_999_9,
    1.000_000_1,
    1.570_796_3,
    3.141_592_7,
    5120.0,
    5123.0,
    5125.0,
    5126.0,
];

/// Applies mutations until the bytes end; `words` are keys and texts that the format has.
pub fn mutate_json(u: &mut Unstructured<'_>, root: &mut Value, words: &[&str]) {
    for _ in 0..MOST {
        if u.is_empty() || mutate_value(u, root, words).is_err() {
            break;
        }
    }
}

/// One mutation of one value of the document.
///
/// # Errors
/// The bytes are at their end.
pub fn mutate_value(u: &mut Unstructured<'_>, root: &mut Value, words: &[&str]) -> Result<()> {
    let values = count(root);
    let place = u.arbitrary::<u16>()? as usize % values;
    let operation = u.arbitrary::<u8>()? % 11;
    let other = u.arbitrary::<u16>()? as usize % values;
    match operation {
        0 => *nth(root, place) = extreme(u)?,
        1 => *nth(root, place) = i64::from(u.arbitrary::<i8>()?).into(),
        2 => *nth(root, place) = (*u.choose(words)?).into(),
        3 => remove(root, place, other),
        4 | 5 if values < MAX_VALUES => {
            let copy = nth(root, other).clone();
            if count(&copy) + values < MAX_VALUES {
                match nth(root, place) {
                    Value::Array(list) if operation == 5 => list.push(copy),
                    Value::Object(map) if operation == 5 => drop(map.insert((*u.choose(words)?).into(), copy)),
                    value => *value = copy,
                }
            }
        }
        6 => {
            let value = extreme(u)?;
            if let Value::Object(map) = nth(root, place) {
                map.insert((*u.choose(words)?).into(), value);
            }
        }
        7 => {
            let factor = *u.choose(&[-1.0, 0.0, 0.5, 2.0, 1e3, 1e-3, 1e9, 1e-9, 1e20, 1e-20, 1e38])?;
            scale(nth(root, place), factor);
        }
        8 => {
            let step = i64::from(u.arbitrary::<i8>()?);
            let value = nth(root, place);
            if let Some(number) = value.as_i64() {
                *value = number.saturating_add(step).into();
            }
        }
        9 => *nth(root, place) = number(f64::from(f32::from_bits(u.arbitrary()?))),
        _ => {
            let (first, second) = (nth(root, place).clone(), nth(root, other).clone());
            if count(&first) + count(&second) + values < MAX_VALUES {
                *nth(root, place) = second;
                let left = count(root);
                *nth(root, other % left) = first;
            }
        }
    }
    Ok(())
}

/// One mutation of a buffer of numbers.
///
/// # Errors
/// The bytes are at their end.
pub fn mutate_buffer(u: &mut Unstructured<'_>, buffer: &mut Vec<u8>) -> Result<()> {
    let place = u.arbitrary::<u16>()? as usize % buffer.len().max(1);
    let operation = u.arbitrary::<u8>()? % 6;
    let mut put = |at: usize, bytes: &[u8]| buffer.iter_mut().skip(at).zip(bytes).for_each(|(b, v)| *b = *v);
    match operation {
        0 => put(place, &u.arbitrary::<[u8; 4]>()?),
        1 => put(place & !3, &(extreme_number(u)? as f32).to_le_bytes()),
        2 => {
            let special = *u.choose(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN_POSITIVE])?;
            put(place & !3, &special.to_le_bytes());
        }
        3 => {
            let length = usize::from(u.arbitrary::<u8>()?);
            put(place, &vec![u.arbitrary()?; length]);
        }
        4 => put(place & !1, &u.arbitrary::<u16>()?.to_le_bytes()),
        _ => buffer.truncate(place),
    }
    Ok(())
}

/// A number at the edge of some range.
///
/// # Errors
/// The bytes are at their end.
pub fn extreme_number(u: &mut Unstructured<'_>) -> Result<f64> {
    u.choose(EXTREMES).copied()
}

fn extreme(u: &mut Unstructured<'_>) -> Result<Value> {
    Ok(match u.arbitrary::<u8>()? % 64 {
        0 => Value::Null,
        1 => true.into(),
        2 => "".into(),
        3 => Value::Array(Vec::new()),
        4 => Value::Object(serde_json::Map::new()),
        5 => vec![0.5; 16].into(),
        6 => u64::MAX.into(),
        7 => i64::MIN.into(),
        _ => number(extreme_number(u)?),
    })
}

/// Whole numbers without a fraction, as indices and counts are written.
fn number(value: f64) -> Value {
    if value.fract() == 0.0 && value.abs() < 9e15 {
        return (value as i64).into();
    }
    Number::from_f64(value).map_or(Value::Null, Value::Number)
}

fn scale(value: &mut Value, factor: f64) {
    match value {
        Value::Number(n) => *value = number(n.as_f64().unwrap_or_default() * factor),
        Value::Array(list) => list.iter_mut().for_each(|v| scale(v, factor)),
        _ => {}
    }
}

fn count(value: &Value) -> usize {
    1 + match value {
        Value::Array(list) => list.iter().map(count).sum(),
        Value::Object(map) => map.values().map(count).sum(),
        _ => 0,
    }
}

/// The value of that number, each before its children; the root for numbers beyond the last one.
fn nth(root: &mut Value, n: usize) -> &mut Value {
    let mut path = Vec::new();
    if !find(root, &mut { n }, &mut path) {
        path.clear();
    }
    path.into_iter().rev().fold(root, |value, child| match value {
        // The path was found in the same document.
        Value::Array(list) => &mut list[child],
        Value::Object(map) => map.values_mut().nth(child).expect("a child that was found"),
        _ => value,
    })
}

/// The children to go through to the value `n` further on, the last one first.
fn find(value: &Value, n: &mut usize, path: &mut Vec<usize>) -> bool {
    if *n == 0 {
        return true;
    }
    *n -= 1;
    let mut seek = |(i, child): (usize, &Value)| {
        let found = find(child, n, path);
        if found {
            path.push(i);
        }
        found
    };
    match value {
        Value::Array(list) => list.iter().enumerate().any(&mut seek),
        Value::Object(map) => map.values().enumerate().any(&mut seek),
        _ => false,
    }
}

/// Removes a child of the value.
fn remove(root: &mut Value, place: usize, child: usize) {
    match nth(root, place) {
        Value::Array(list) if !list.is_empty() => drop(list.remove(child % list.len())),
        Value::Object(map) if !map.is_empty() => {
            let key = map.keys().nth(child % map.len()).cloned().unwrap_or_default();
            map.remove(&key);
        }
        value => *value = Value::Null,
    }
}
