use super::*;
use crate::geometry::Vec3;

fn utm(zone: u32) -> Projection {
    Projection::new(&format!("EPSG:{}", 32600 + zone)).unwrap()
}

/// Meridian convergence of the transverse Mercator projection as a series in the longitude from the
/// central meridian, up to the fifth order: accurate to 1e-10 rad at 3°.
fn utm_convergence_rad(latitude: f64, from_meridian: f64) -> f64 {
    let (s, c) = latitude.sin_cos();
    let t2 = (s / c).powi(2);
    let ratio = SEMI_MAJOR_M / SEMI_MINOR_M;
    let eta2 = (ratio * ratio - 1.0) * c * c;
    let l2 = (from_meridian * c).powi(2);
    let third = l2 / 3.0 * (1.0 + 3.0 * eta2 + 2.0 * eta2 * eta2);
    let fifth = l2 * l2 / 15.0 * (2.0 - t2 + eta2 * (15.0 - 15.0 * t2));
    from_meridian * s * (1.0 + third + fifth)
}

#[test]
fn the_convergence_agrees_with_its_series() {
    let system = utm(32);
    for latitude_deg in [-60.0f64, -20.0, 0.0, 35.0, 50.7, 70.0] {
        for from_meridian_deg in [-3.0f64, -1.3, 0.0, 0.01, 2.0, 3.0] {
            let latitude = latitude_deg.to_radians();
            let from_meridian = from_meridian_deg.to_radians();
            let point = system
                .project(latitude, 9f64.to_radians() + from_meridian)
                .unwrap();
            let off = point.convergence_rad - utm_convergence_rad(latitude, from_meridian);
            assert!(
                off.abs() < 1e-9,
                "{latitude_deg} {from_meridian_deg}: {off:e}"
            );
        }
    }
    // East of the central meridian on the northern hemisphere, grid north lies east of true north.
    let point = system.project(0.9, 10f64.to_radians()).unwrap();
    assert!(point.convergence_rad > 0.0);
    // True north then points west of grid north.
    assert!((point.grid_from_true() * Vec3::y()).x < 0.0);
}

/// `tests/data/projection/pyproj.csv` was computed with pyproj 3.7.2 (PROJ 9.5.1): `Proj(crs)` forwards, and
/// `get_factors`; with `+ellps=GRS80` for EPSG:26910, because PROJ computes `+datum=NAD83` on the ellipsoid of
/// WGS 84.
#[test]
fn coordinates_convergence_and_scale_agree_with_proj() {
    let table = include_str!("../../../../../tests/data/projection/pyproj.csv");
    let mut count = 0;
    for line in table.lines().skip(1) {
        let (name, numbers) = line.split_once(',').unwrap();
        let v: Vec<f64> = numbers.split(',').map(|v| v.parse().unwrap()).collect();
        let system = Projection::new(name).unwrap();
        let (latitude, longitude) = (v[0].to_radians(), v[1].to_radians());
        let point = system.project(latitude, longitude).unwrap();
        let off_m = (point.east_m - v[2]).hypot(point.north_m - v[3]);
        assert!(off_m < 1e-6, "{line}: {off_m} m");
        let off = (point.convergence_rad - v[4].to_radians()).abs();
        assert!(off < 1e-8, "{line}: {off} rad");
        assert!((point.scale - v[5]).abs() < 1e-8, "{line}: {}", point.scale);
        let back = system.unproject(point.east_m, point.north_m).unwrap();
        let off = (back.0 - latitude).hypot((back.1 - longitude) * latitude.cos());
        // 6 µm: the inverses of some projections are iterative.
        assert!(off < 1e-12, "{line}: {off} rad");
        count += 1;
    }
    assert!(count > 100);
}

#[test]
fn errors_name_their_cause() {
    for (name, expected) in [
        ("UTM32", "`UTM32` is not understood"),
        ("", "`` is not understood"),
        ("EPSG:", "EPSG: is not a known code"),
        ("EPSG:99999", "EPSG:99999 is not a known code"),
        ("EPSG:4326", "not projected"),
        ("EPSG:4978", "not projected"),
        // A German system on the ellipsoid of Bessel, Web Mercator on a sphere.
        ("EPSG:31467", "no datum shift"),
        ("EPSG:3857", "its ellipsoid"),
        // Israel: GRS 80, but with a datum shift.
        ("EPSG:2039", "towgs84=-48,55,52,0,0,0,0`: a datum shift"),
        ("EPSG:5555", "`+vunits=m`: a vertical system"),
        // Feet.
        ("EPSG:2263", "not in metres"),
        ("+proj=utm +ellps=GRS80", "without +zone"),
        ("+proj=utm +zon=32", "`+zon=32`: an unknown parameter"),
        ("+proj=utm +zone=32 +zone=33", "given twice"),
        ("+proj=utm +zone=abc +ellps=GRS80", "cannot be used"),
        ("+proj=nowhere +ellps=GRS80", "cannot be used"),
        ("+proj=tmerc +ellps=\"GRS80\"", "unexpected characters"),
        (
            "+proj=tmerc lon_0=9",
            "`lon_0=9`: a parameter begins with +",
        ),
        ("+proj=utm +zone=32 +axis=neu", "east, north, up"),
        ("+proj=utm +zone=32 +nadgrids=BETA2007.gsb", "a datum shift"),
        ("+proj=utm +zone=32 +units=us-ft", "not in metres"),
    ] {
        let error = Projection::new(name).unwrap_err().to_string();
        assert!(error.contains(expected), "{name}: {error}");
    }
    for name in [
        " epsg:25832 ",
        "+proj=tmerc +lon_0=7.1 +lat_0=50.7 +k=1 +ellps=GRS80",
    ] {
        assert_eq!(Projection::new(name).unwrap().name(), name.trim());
    }
}

#[test]
fn places_outside_a_system_are_refused() {
    let system = utm(32);
    let failed = |system: &Projection, latitude_deg: f64, longitude_deg: f64| {
        let (latitude, longitude) = (latitude_deg.to_radians(), longitude_deg.to_radians());
        system.project(latitude, longitude).unwrap_err().to_string()
    };
    for (latitude, longitude) in [(91.0, 9.0), (90.0, 9.0), (f64::NAN, 9.0), (50.0, f64::NAN)] {
        assert!(failed(&system, latitude, longitude).contains("within ±89.9°"));
    }
    assert!(failed(&system, 50.0, 30.0).contains("of true ones"));
    assert!(failed(&system, 0.0, 99.0).contains("EPSG:32632"));
    let europe = Projection::new("EPSG:3035").unwrap();
    assert!(failed(&europe, 50.7, 7.1).contains("not conformal"));
    let mercator = Projection::new("EPSG:3395").unwrap();
    assert!(failed(&mercator, 50.7, 7.1).contains("are 1.57"));
    for (east, north) in [
        (f64::NAN, 0.0),
        (1e12, 0.0),
        (5e5, f64::INFINITY),
        (5e5, 1e8),
    ] {
        assert!(system.unproject(east, north).is_err(), "{east} {north}");
    }
}

/// The strings come from files of users: the library must not panic on any of them.
#[test]
fn damaged_strings_are_refused_or_read() {
    let valid =
        "+proj=omerc +lat_0=4 +lonc=102d15'3.5\"E +alpha=323.1 +k=0.99984 +ellps=GRS80 +units=m";
    let pieces = [
        "", "+", "=", "'", "\"", "d", "r", "°", "nan", "1e999", "-", ",", " ", "proj",
    ];
    let mut read = 0;
    for at in (0..valid.len()).filter(|at| valid.is_char_boundary(*at)) {
        for piece in pieces {
            for cut in [0, 1, 5] {
                let end = (at + cut).min(valid.len());
                let text = format!("{}{piece}{}", &valid[..at], &valid[end..]);
                let text = text.replace("3.5\"", "");
                if let Ok(system) = Projection::new(&text) {
                    read += 1;
                    let _ = system.project(0.1, 1.8);
                    let _ = system.unproject(1e5, 1e5);
                }
            }
        }
    }
    assert!(read > 10, "{read}");
}
