//! Text in Windows-1252, of which Latin-1 is the part that texts use.

/// The characters of the bytes 0x80 to 0x9f; the replacement character stands for bytes without one.
const UPPER: [char; 32] = [
    '€', '\u{fffd}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{fffd}', 'Ž',
    '\u{fffd}', '\u{fffd}', '‘', '’', '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{fffd}',
    'ž', 'Ÿ',
];
/// At most one in so many bytes of a line of text is not ASCII; in binary files it is half of them.
const FEW: usize = 3;

/// The text of a line that is not UTF-8; `None` if it looks like binary data.
pub(super) fn decode(line: &[u8]) -> Option<String> {
    let is_control = |byte: &u8| byte.is_ascii_control() && !byte.is_ascii_whitespace();
    let others = line.iter().filter(|byte| !byte.is_ascii()).count();
    if line.iter().any(is_control) || FEW * others > line.len() {
        return None;
    }
    let text: String = line
        .iter()
        .map(|byte| match byte {
            0x80..=0x9f => UPPER[usize::from(byte - 0x80)],
            _ => char::from(*byte),
        })
        .collect();
    (!text.contains('\u{fffd}')).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_windows_are_told_from_binary_data() {
        let line = b"Rechtswert;Hochwert;H\xf6he;\x80";
        assert_eq!(decode(line).unwrap(), "Rechtswert;Hochwert;Höhe;€");
        for line in [
            &b"a\x00\xf6"[..],
            b"abcdef\x81",
            b"\xff\xd8\xff\xe0abc",
            b"abcdefgh\x1b\xe4",
        ] {
            assert_eq!(decode(line), None);
        }
    }
}
