//! Numbers as people read them.

/// `value` with so many significant digits: as a decimal where that is short, else with an exponent.
pub fn significant(value: f64, digits: usize) -> String {
    let more = digits.saturating_sub(1);
    let with_exponent = format!("{value:.more$e}");
    let exponent = with_exponent.split_once('e').and_then(|(_, exponent)| exponent.parse::<i64>().ok());
    match exponent {
        Some(exponent @ -4..6) => format!("{value:.*}", usize::try_from(more as i64 - exponent).unwrap_or(0)),
        _ => with_exponent,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_digits_however_small_or_large_they_are() {
        for (value, text) in [
            (0.3, "0.3000"),
            (-0.000_316, "-0.0003160"),
            (2.0e-8, "2.000e-8"),
            (0.999_99, "1.000"),
            (123_456.0, "123456"),
            (1e308, "1.000e308"),
            (0.0, "0.000"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(significant(value, 4), text);
        }
    }
}
