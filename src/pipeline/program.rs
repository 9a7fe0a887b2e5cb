//! Identity of the program.

/// The version and a hash of the sources. Programs with the same key give the same results, so finished stages, pages
/// and items of a campaign that one of them keeps on disk are valid for the others.
pub const PROGRAM: &str = concat!(env!("CARGO_PKG_VERSION"), " ", env!("BORESIGHT_SOURCES"));

#[cfg(test)]
mod tests {
    #[test]
    fn sources_are_named() {
        let (version, sources) = super::PROGRAM.split_once(' ').unwrap();
        assert_eq!(version, env!("CARGO_PKG_VERSION"));
        assert_eq!(sources.len(), 32);
        assert!(sources.chars().all(|digit| digit.is_ascii_hexdigit()));
    }
}
