//! Requests and replies of the GeoCOM ASCII protocol.
//!
//! A request is `%R1Q,<procedure>[,<transaction>[,<checksum>]]:<parameters>`, a reply
//! `%R1P,<communication code>[,<transaction>[,<checksum>]]:<procedure's code>[,<values>]`; both end
//! with CR LF (*GeoCOM Reference Manual*, "ASCII Protocol Syntax").

use super::codes::ReturnCode;

/// A parameter or a value in a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// An integer, an enumeration or a switch (0, 1).
    Integer(i64),
    /// A number with decimals; a number that is not finite is written as 0.
    Float {
        /// The number.
        value: f64,
        /// Digits after the decimal point.
        decimals: usize,
    },
    /// A text, written in double quotes.
    Text(String),
    /// A byte, written as two hexadecimal digits in single quotes.
    Byte(u8),
}

impl Value {
    /// A number with 15 decimals, the instruments' default.
    pub fn float(value: f64) -> Self {
        Self::Float {
            value,
            decimals: 15,
        }
    }

    fn write(&self, to: &mut String) {
        match self {
            Self::Integer(value) => to.push_str(&value.to_string()),
            Self::Float { value, decimals } => {
                let value = if value.is_finite() { *value } else { 0.0 };
                // No type of the instrument has more digits.
                let text = format!("{value:.*}", (*decimals).min(17));
                let short = text.trim_end_matches('0');
                match (text.contains('.'), short.ends_with('.')) {
                    (false, _) => to.push_str(&text),
                    (true, false) => to.push_str(short),
                    (true, true) => to.push_str(&format!("{short}0")),
                }
            }
            Self::Text(text) => {
                to.push('"');
                for byte in text.bytes() {
                    match byte {
                        b'\\' | b'"' | b'%' | b'~' => to.extend(['\\', char::from(byte)]),
                        0x20..=0x7e => to.push(char::from(byte)),
                        _ => to.push_str(&format!("\\x{byte:02X}")),
                    }
                }
                to.push('"');
            }
            Self::Byte(byte) => to.push_str(&format!("'{byte:02x}'")),
        }
    }
}

/// The fields of a received message, which the caller reads as the types that it expects.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Fields(Vec<String>);

impl Fields {
    fn parse(text: &str) -> Self {
        if text.is_empty() {
            return Self::default();
        }
        let mut fields = vec![String::new()];
        let (mut quote, mut is_escaped) = (None, false);
        for character in text.chars() {
            match (quote, character) {
                (None, ',') => {
                    fields.push(String::new());
                    continue;
                }
                (None, '"' | '\'') => quote = Some(character),
                (Some(open), _) if open == character && !is_escaped => quote = None,
                _ => {}
            }
            is_escaped = quote.is_some() && character == '\\' && !is_escaped;
            if let Some(last) = fields.last_mut() {
                last.push(character);
            }
        }
        Self(fields)
    }

    /// Number of fields.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no fields.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Field `i` as it was received.
    pub fn raw(&self, i: usize) -> Option<&str> {
        self.0.get(i).map(String::as_str)
    }

    /// Field `i` as an integer, decimal or hexadecimal with `0x`.
    pub fn integer(&self, i: usize) -> Option<i64> {
        let text = self.raw(i)?.trim();
        match text.strip_prefix("0x").or(text.strip_prefix("0X")) {
            Some(digits) => i64::from_str_radix(digits, 16).ok(),
            None => text.parse().ok(),
        }
    }

    /// Field `i` as a finite number.
    pub fn float(&self, i: usize) -> Option<f64> {
        let value: f64 = self.raw(i)?.trim().parse().ok()?;
        value.is_finite().then_some(value)
    }

    /// Field `i` as a text in double quotes.
    pub fn text(&self, i: usize) -> Option<String> {
        let inner = self.raw(i)?.trim().strip_prefix('"')?.strip_suffix('"')?;
        let mut bytes = Vec::with_capacity(inner.len());
        let mut rest = inner.bytes();
        while let Some(byte) = rest.next() {
            match byte {
                b'\\' => match rest.next()? {
                    b'x' | b'X' => {
                        let digits = [rest.next()?, rest.next()?];
                        let digits = std::str::from_utf8(&digits).ok()?;
                        bytes.push(u8::from_str_radix(digits, 16).ok()?);
                    }
                    other => bytes.push(other),
                },
                _ => bytes.push(byte),
            }
        }
        Some(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Field `i` as a byte: two hexadecimal digits in single quotes.
    pub fn byte(&self, i: usize) -> Option<u8> {
        let digits = self.raw(i)?.trim().strip_prefix('\'')?.strip_suffix('\'')?;
        match digits.len() {
            2 => u8::from_str_radix(digits, 16).ok(),
            _ => None,
        }
    }
}

/// The reason why a line is not a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Malformed {
    /// It does not follow the protocol's syntax.
    Syntax,
    /// Its checksum is not that of its content.
    Checksum,
}

/// A request to an instrument.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// Number of the remote procedure.
    pub procedure: u16,
    /// Number that the reply repeats.
    pub transaction: Option<u16>,
    /// Whether the request has a checksum, which asks for a checksum in the reply.
    pub has_checksum: bool,
    /// Parameters.
    pub fields: Fields,
}

/// A reply of an instrument.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// The code of the communication.
    pub communication: ReturnCode,
    /// Number of the request's transaction; 0 if it had none.
    pub transaction: u16,
    /// Whether the reply has a checksum.
    pub has_checksum: bool,
    /// The code of the procedure.
    pub code: ReturnCode,
    /// The values.
    pub fields: Fields,
}

impl Request {
    /// The line of a request, without terminator.
    pub fn line(procedure: u16, transaction: u16, parameters: &[Value], checked: bool) -> String {
        line(
            &format!("%R1Q,{procedure},{transaction}"),
            parameters,
            checked,
        )
    }

    /// Parses the line of a request, without terminator.
    ///
    /// # Errors
    /// If the line has another syntax or a wrong checksum.
    pub fn parse(line: &[u8]) -> Result<Self, Malformed> {
        let message = Message::parse(line, "%R1Q,")?;
        Ok(Self {
            procedure: message.first,
            transaction: message.transaction,
            has_checksum: message.has_checksum,
            fields: Fields::parse(message.body),
        })
    }
}

impl Reply {
    /// The line of a reply, without terminator.
    pub fn line(
        communication: ReturnCode,
        transaction: u16,
        code: ReturnCode,
        values: &[Value],
        checked: bool,
    ) -> String {
        let mut all = vec![Value::Integer(i64::from(code.0))];
        all.extend_from_slice(values);
        line(
            &format!("%R1P,{},{transaction}", communication.0),
            &all,
            checked,
        )
    }

    /// Parses the line of a reply, without terminator.
    ///
    /// # Errors
    /// If the line has another syntax or a wrong checksum.
    pub fn parse(line: &[u8]) -> Result<Self, Malformed> {
        let message = Message::parse(line, "%R1P,")?;
        let (code, values) = message.body.split_once(',').unwrap_or((message.body, ""));
        let communication = ReturnCode(message.first);
        let code = match number(code) {
            Some(code) => code,
            // If the communication failed, there may be no procedure and no code.
            None if code.is_empty() && communication != ReturnCode::OK => 0,
            None => return Err(Malformed::Syntax),
        };
        Ok(Self {
            communication,
            transaction: message.transaction.unwrap_or(0),
            has_checksum: message.has_checksum,
            code: ReturnCode(code),
            fields: Fields::parse(values),
        })
    }
}

/// The common parts of requests and replies.
struct Message<'a> {
    first: u16,
    transaction: Option<u16>,
    has_checksum: bool,
    body: &'a str,
}

impl<'a> Message<'a> {
    fn parse(line: &'a [u8], prefix: &str) -> Result<Self, Malformed> {
        if !line.iter().all(|byte| (0x20..=0x7e).contains(byte)) {
            return Err(Malformed::Syntax);
        }
        let text = std::str::from_utf8(line).map_err(|_| Malformed::Syntax)?;
        let rest = text.strip_prefix(prefix).ok_or(Malformed::Syntax)?;
        let (header, body) = rest.split_once(':').ok_or(Malformed::Syntax)?;
        let mut numbers = [None; 3];
        for (i, field) in header.split(',').enumerate() {
            *numbers.get_mut(i).ok_or(Malformed::Syntax)? =
                Some(number(field).ok_or(Malformed::Syntax)?);
        }
        let [Some(first), transaction, received_checksum] = numbers else {
            return Err(Malformed::Syntax);
        };
        if let Some(received) = received_checksum {
            let end = header.rfind(',').unwrap_or(header.len());
            let checked = format!("{prefix}{}:{body}", &header[..end]);
            if checksum(checked.as_bytes()) != received {
                return Err(Malformed::Checksum);
            }
        }
        Ok(Self {
            first,
            transaction,
            has_checksum: received_checksum.is_some(),
            body,
        })
    }
}

/// Parses decimal digits; `parse` alone would accept a sign as well.
fn number(text: &str) -> Option<u16> {
    let has_digits_only = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    has_digits_only.then(|| text.parse().ok()).flatten()
}

fn line(header: &str, values: &[Value], checked: bool) -> String {
    let mut body = String::new();
    for (i, value) in values.iter().enumerate() {
        if i > 0 {
            body.push(',');
        }
        value.write(&mut body);
    }
    let plain = format!("{header}:{body}");
    if checked {
        format!("{header},{}:{body}", checksum(plain.as_bytes()))
    } else {
        plain
    }
}

/// CRC-16/ARC of a message without its checksum and its terminator.
pub fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |sum, &byte| {
        (0..8).fold(sum ^ u16::from(byte), |sum, _| match sum & 1 {
            0 => sum >> 1,
            _ => (sum >> 1) ^ 0xa001,
        })
    })
}
