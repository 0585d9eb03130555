//! Text as a terminal and a page may show it. Names, paths and numbers come from files that anybody may have made: nothing in
//! them steers the terminal or breaks the page, and no number is longer than anybody reads.

/// Text of several lines, whose ends and tabulators stay.
pub fn lines(text: &str) -> String {
    shortened(&spelt_out(text, |letter| !matches!(letter, '\n' | '\t'), |letter| letter.escape_unicode().to_string()))
}

/// Text that is to stay on one line.
pub fn line(text: &str) -> String {
    shortened(&spelt_out(text, |_| true, |letter| letter.escape_unicode().to_string()))
}

/// JSON, which spells out the same letters in its own way.
pub fn json(text: &str) -> String {
    let as_json = |letter: char| {
        let mut units = [0; 2];
        letter.encode_utf16(&mut units).iter().map(|unit| format!("\\u{unit:04x}")).collect()
    };
    spelt_out(text, |_| true, as_json)
}

/// Whether a letter does something to a terminal, or is none that XML may hold.
fn steers(letter: char) -> bool {
    letter.is_control()
        // Line ends of their own, letters that turn the direction of all that follows, and what is no letter.
        || matches!(letter, '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{fffe}' | '\u{ffff}')
}

fn spelt_out(text: &str, wanted: impl Fn(char) -> bool, how: impl Fn(char) -> String) -> String {
    let mut shown = String::with_capacity(text.len());
    for letter in text.chars() {
        if steers(letter) && wanted(letter) { shown += &how(letter) } else { shown.push(letter) }
    }
    shown
}

/// The most digits a number has whose every digit says something, and some.
const MOST_DIGITS: usize = 24;

/// The text with numbers of more digits in scientific notation, from which they are read as the same again.
fn shortened(text: &str) -> String {
    let mut short = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(|letter: char| letter.is_ascii_digit()) {
        let (before, from) = rest.split_at(at);
        short += before;
        let (number, after) = from.split_at(length(from));
        // Digits in a word, a path or the name of a file are no number.
        let joins = |letter: char| letter.is_alphanumeric() || matches!(letter, '_' | '/' | '\\' | '.');
        let alone = !short.ends_with(joins) && !after.trim_start_matches('.').starts_with(joins);
        match number.parse::<f64>() {
            Ok(value) if alone && is_long(number) && value.is_finite() => short += &format!("{value:e}"),
            _ => short += number,
        }
        rest = after;
    }
    short + rest
}

/// Length of the number that `text` begins with: digits, and a fraction if there is one.
fn length(text: &str) -> usize {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    let whole = digits(text);
    match text[whole..].strip_prefix('.').map(digits) {
        Some(fraction @ 1..) => whole + 1 + fraction,
        _ => whole,
    }
}

fn is_long(number: &str) -> bool {
    // What begins with a zero but is below one is somebody's running number.
    number.len() > MOST_DIGITS && (number.starts_with("0.") || !number.starts_with('0'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_steers_the_terminal() {
        let hostile = "a\u{1b}[2J\r\u{7}\u{9b}31mb\u{202e}\n\tend";
        assert_eq!(lines(hostile), "a\\u{1b}[2J\\u{d}\\u{7}\\u{9b}31mb\\u{202e}\n\tend");
        assert_eq!(line(hostile), "a\\u{1b}[2J\\u{d}\\u{7}\\u{9b}31mb\\u{202e}\\u{a}\\u{9}end");
        assert_eq!(line("kg m², ±1 – “ß”"), "kg m², ±1 – “ß”");
        let read: String = serde_json::from_str(&json(&serde_json::json!(hostile).to_string())).unwrap();
        assert_eq!(read, hostile);
        assert!(!json(&serde_json::json!(hostile).to_string()).contains(char::is_control));
    }

    #[test]
    fn numbers_are_short_and_read_as_the_same() {
        for value in [1e300, -1.234_567_890_123_456_7e300, f64::MAX, 1e-300, 1e25, f64::from(f32::MAX)] {
            for text in [format!("f1 = [{value}, 1]"), format!("is {value}; lower it")] {
                let shown = line(&text);
                assert!(shown.len() < 45, "{shown}");
                let read = shown.split([' ', '[', ',', ';']).find_map(|word| word.parse::<f64>().ok());
                assert_eq!(read, Some(value), "{shown}");
            }
        }
        assert_eq!(line(&format!("reaches {:.4} rad.", 1e300)), "reaches 1e300 rad.");
        assert_eq!(line(&format!("is {}.", 1e300)), "is 1e300.");
    }

    #[test]
    fn whatever_is_no_long_number_stays() {
        let digits = "12345678901234567890123456789";
        for text in [
            format!("{digits}.csv is there"),
            format!("./{digits}/run.csv, a{digits} {digits}b {digits}_"),
            format!("crc 0{digits}"),
            "12345678901234567890, 0.30000000000000004 and 0.00001234567890123456".into(),
        ] {
            assert_eq!(line(&text), text);
        }
    }
}
