//! Repairs the checksums of mutated inputs; otherwise hardly any input would pass the first check of its reader.

use crc::{Algorithm, CRC_16_KERMIT, CRC_32_ISCSI, CRC_32_ISO_HDLC, Crc};

/// Sets the checksums of all pages of an E57 file.
pub fn e57(bytes: &mut [u8]) {
    const PAGE: usize = 1024;
    const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISCSI);
    for page in bytes.chunks_exact_mut(PAGE) {
        let (data, sum) = page.split_at_mut(PAGE - 4);
        sum.copy_from_slice(&CRC.checksum(data).to_be_bytes());
    }
}

/// Sets the checksums and ends of all frames of an sbgECom log.
pub fn sbg(bytes: &mut [u8]) {
    const CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_KERMIT);
    let mut at = 0;
    while let Some(head) = bytes.get(at..at + 6) {
        let end = at + 6 + usize::from(u16::from_le_bytes([head[4], head[5]]));
        if !head.starts_with(&[0xff, 0x5a]) || end + 3 > bytes.len() {
            at += 1;
            continue;
        }
        let sum = CRC.checksum(&bytes[at + 2..end]);
        bytes[end..end + 2].copy_from_slice(&sum.to_le_bytes());
        bytes[end + 2] = 0x33;
        at = end + 3;
    }
}

/// Sets the checksums of all NMEA sentences that have one.
pub fn nmea(bytes: &mut [u8]) {
    let mut start = None;
    for at in 0..bytes.len() {
        match (bytes[at], start) {
            (b'$', _) => start = Some(at + 1),
            (b'\r' | b'\n', _) => start = None,
            (b'*', Some(first)) => {
                let sum = bytes[first..at].iter().fold(0, |sum, byte| sum ^ byte);
                let digits = format!("{sum:02X}");
                if let Some(place) = bytes.get_mut(at + 1..at + 3) {
                    place.copy_from_slice(digits.as_bytes());
                }
                start = None;
            }
            _ => {}
        }
    }
}

/// Sets the checksums of all messages of NovAtel and Unicore that have one.
pub fn novatel(bytes: &mut [u8]) {
    const CRC: Crc<u32> = Crc::<u32>::new(&Algorithm {
        init: 0,
        xorout: 0,
        ..CRC_32_ISO_HDLC
    });
    for line in bytes.split_mut(|byte| *byte == b'\n') {
        let end = line.iter().rposition(|byte| *byte == b'*');
        if let Some(end) = end.filter(|_| line.starts_with(b"#") || line.starts_with(b"%")) {
            let digits = format!("{:08x}", CRC.checksum(&line[1..end]));
            if let Some(place) = line.get_mut(end + 1..end + 9) {
                place.copy_from_slice(digits.as_bytes());
            }
        }
    }
}

/// Whether an input with this seed keeps its wrong checksums, which one input in eight does.
pub fn is_left(seed: u32) -> bool {
    seed.is_multiple_of(8)
}
