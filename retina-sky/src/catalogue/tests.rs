use std::path::Path;

use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::ephemeris::Ephemeris;
use crate::time::parse_epoch;

const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;
const HEADER: &str = "id,ra_deg,dec_deg,pm_ra_mas_yr,pm_dec_mas_yr,parallax_mas,v_mag,b_v";

fn parse(rows: &str) -> Result<StarCatalogue, InputError> {
    StarCatalogue::parse(Path::new("own.csv"), &format!("# mine\n{HEADER}\n{rows}"))
}

fn place_deg(direction: DVec3) -> (f64, f64) {
    (direction.y.atan2(direction.x).to_degrees().rem_euclid(360.0), direction.z.asin().to_degrees())
}

#[test]
fn the_bright_end_is_complete() {
    let catalogue = StarCatalogue::embedded();
    assert_eq!(catalogue.stars().len(), 57_479);
    // V of the Bright Star Catalogue (Hoffleit & Warren 1991) for stars that are not or little variable.
    let published =
        [(32_349, -1.46), (30_438, -0.72), (69_673, -0.04), (91_262, 0.03), (24_608, 0.08), (24_436, 0.12)];
    for (k, (hip, v)) in published.into_iter().enumerate() {
        let star = catalogue.hipparcos(hip).unwrap();
        assert!((star.v_magnitude - v).abs() < 0.11, "HIP {hip}: {}", star.v_magnitude);
        assert!(k != 0 || catalogue.stars()[0].id == star.id);
    }
    // Betelgeuse, V 0.42 to 0.58 on the average; alpha Cen A -0.01.
    assert!((catalogue.hipparcos(27_989).unwrap().v_magnitude - 0.5).abs() < 0.15);
    assert!((catalogue.hipparcos(71_683).unwrap().v_magnitude + 0.01).abs() < 0.02);
    // Counts of XHIP itself, in which HIP 115125 has the magnitude of 94 Aqr as a whole, 5.19, here its own 7.50.
    let to = |limit: f64| catalogue.stars().iter().filter(|star| star.v_magnitude <= limit).count();
    assert_eq!([to(4.0), to(8.25)], [519, 51_074]);
    assert!(catalogue.stars().is_sorted_by(|a, b| a.v_magnitude <= b.v_magnitude));
    for hip in [55_203, 78_727, 115_125] {
        let star = catalogue.hipparcos(hip).unwrap();
        assert!(star.notes.not_in_i311 && !star.notes.no_proper_motion && star.parallax_rad > 0.0);
    }
    assert_eq!(StarId::Hipparcos(32_349).to_string(), "HIP 32349");
}

#[test]
fn places_are_the_published_ones() {
    // Hipparcos (ESA 1997, I/239), J1991.25: Sirius 101.288541, -16.713143; Polaris 37.946143, 89.264138.
    let published: [(u32, f64, f64); 2] =
        [(32_349, 101.288_541, -16.713_143), (11_767, 37.946_143, 89.264_138)];
    for (hip, ra_deg, dec_deg) in published {
        let star = StarCatalogue::embedded().hipparcos(hip).unwrap();
        let (ra, dec) = place_deg(star.direction);
        let off_deg = ((ra - ra_deg) * dec_deg.to_radians().cos()).hypot(dec - dec_deg);
        assert!(off_deg * 3600.0 < 0.02, "HIP {hip}: {ra} {dec}");
    }
    // Fomalhaut, B-V 0.145 (I/239).
    assert!((StarCatalogue::embedded().hipparcos(113_368).unwrap().b_v.unwrap() - 0.145).abs() < 1e-9);
}

#[test]
fn barnards_star_keeps_its_pace() {
    // I/239 (ESA 1997), J1991.25: 269.454023, +4.668288, pm -797.84, 10326.93 mas/yr. To J2050 it goes
    // 58.75 yr * 10.358 arcsec = 608.5 arcsec, mostly north: dec 4.668288 + 0.168529 deg, and
    // ra 269.454023 - 58.75 * 0.79784 / 3600 / cos(4.7525 deg) = 269.440958.
    // The faintest here is V 8.4 and Barnard's star is 9.5, so it comes as a user's own.
    let catalogue = parse("barnard,269.454023,4.668288,-797.84,10326.93,549.01,9.54,1.57\n").unwrap();
    let tdb_s = 50.0 * YEAR_S;
    let (ra, dec) = place_deg(catalogue.stars()[0].direction_from(DVec3::ZERO, tdb_s));
    assert!((dec - 4.836_817).abs() < 2e-6 && (ra - 269.440_958).abs() < 2e-6, "{ra} {dec}");
    // An epoch of its own: at J2050 it stands where the row says.
    let text = format!("{HEADER},epoch_jyear\nb,10,20,500,500,0,3,,2050\n");
    let catalogue = StarCatalogue::parse(Path::new("own.csv"), &text).unwrap();
    let (ra, dec) = place_deg(catalogue.stars()[0].direction_from(DVec3::ZERO, tdb_s));
    assert!((ra - 10.0).abs() < 1e-9 && (dec - 20.0).abs() < 1e-9, "{ra} {dec}");
}

#[test]
fn alpha_centauri_swings_by_its_parallax() {
    // 754.81 mas (I/311). From two places 10 au apart, at right angles to its direction, it is seen
    // 7.548 arcsec apart.
    let star = StarCatalogue::embedded().hipparcos(71_683).unwrap();
    let across = star.direction.any_orthonormal_vector() * 5.0 * ASTRONOMICAL_UNIT_M;
    let (one, other) = (star.direction_from(across, 0.0), star.direction_from(-across, 0.0));
    assert!((separation_rad(one, other) / ARCSEC - 7.5481).abs() < 2e-3);
    assert!((other - one).dot(across) > 0.0, "a near star stands back from the side one moves to");
}

#[test]
fn a_cone_holds_what_a_search_of_all_stars_finds() {
    let catalogue = StarCatalogue::embedded();
    let tdb_s = parse_epoch("2031-05-06").unwrap();
    let position_m = DVec3::new(-3.0, 2.5, 1.0) * ASTRONOMICAL_UNIT_M;
    // The second moves at a tenth of light's speed: aberration of 5.7 deg shows a cone drawn too narrowly.
    for velocity_m_s in [DVec3::new(-1e4, -1e4, 3e3), DVec3::new(0.0, 2.1e7, 2.1e7)] {
        let observer = Observer::new(&Ephemeris::analytic(), tdb_s, position_m, Some(velocity_m_s)).unwrap();
        for (axis, half_angle_rad, faintest) in [
            (DVec3::new(0.1, -0.9, 0.3).normalize(), 0.176, 8.25),
            (DVec3::Z, 0.01, 8.4),
            (-DVec3::X, 3.2, 5.0),
            (DVec3::new(1.0, 1.0, 0.2).normalize(), 0.3, 6.0),
        ] {
            let found = catalogue.in_cone(&observer, axis, half_angle_rad, faintest);
            let expected = catalogue
                .stars()
                .iter()
                .filter(|star| star.v_magnitude <= faintest && !star.notes.doubtful)
                .filter(|star| {
                    let seen = observer.apparent_star(star.direction_from(position_m, tdb_s));
                    separation_rad(seen, axis) <= half_angle_rad
                });
            assert!(found.iter().map(|seen| &seen.star.id).eq(expected.map(|star| &star.id)));
            assert!(!found.is_empty());
        }
    }
}

#[test]
fn doubtful_entries_are_kept_but_not_seen() {
    let catalogue = StarCatalogue::embedded();
    let doubtful = catalogue.hipparcos(59_273).unwrap();
    assert!(doubtful.notes.doubtful);
    let observer = Observer::new(&Ephemeris::analytic(), 0.0, DVec3::ZERO, None).unwrap();
    let seen = catalogue.in_cone(&observer, doubtful.direction, 20.0 * ARCSEC, 8.4);
    assert_eq!(seen.iter().map(|seen| seen.star.id.to_string()).collect::<Vec<_>>(), ["HIP 59272"]);
}

#[test]
fn broken_tables_are_refused_at_line_and_column() {
    let good = "a,10,20,1,2,3,4.5,\nb,350,-20,0,0,-1,2.5,0.6\n";
    let catalogue = parse(good).unwrap();
    assert_eq!(catalogue.stars()[0].id, StarId::Named("b".to_owned()));
    assert_eq!(catalogue.stars()[0].parallax_rad, 0.0);
    assert_eq!((catalogue.stars()[1].b_v, catalogue.stars()[0].b_v), (None, Some(0.6)));
    for (row, expected) in [
        ("c,,0,0,0,0,5,", "line 5, column `ra_deg`"),
        ("c,1,north,0,0,0,5,", "line 5, column `dec_deg`"),
        ("c,1,90.5,0,0,0,5,", "line 5, column `dec_deg`"),
        ("c,361,0,0,0,0,5,", "line 5, column `ra_deg`"),
        ("c,1,0,NaN,0,0,5,", "line 5, column `pm_ra_mas_yr`"),
        ("c,1,0,0,inf,0,5,", "line 5, column `pm_dec_mas_yr`"),
        ("c,1,0,0,0,,5,", "line 5, column `parallax_mas`"),
        ("c,1,0,0,0,0,,", "line 5, column `v_mag`"),
        ("c,1,0,0,0,0,5,blue", "line 5, column `b_v`"),
        (",1,0,0,0,0,5,", "line 5, column `id`"),
        ("a,1,0,0,0,0,5,", "`a`, as on line 3"),
        ("c,1,0", "line 5"),
    ] {
        let error = parse(&format!("{good}{row}\n")).unwrap_err().to_string();
        assert!(error.contains(expected), "{row}: {error}");
    }
    let error = StarCatalogue::parse(Path::new("own.csv"), &format!("{HEADER},epoch_year\n")).unwrap_err();
    assert!(error.to_string().contains("epoch_year") && error.help.unwrap().contains("epoch_jyear"));
    let error = StarCatalogue::parse(Path::new("own.csv"), "id,ra_deg\n").unwrap_err();
    assert!(error.to_string().contains("`dec_deg`"));
    assert!(parse("").unwrap_err().to_string().contains("holds no stars"));
    assert!(StarCatalogue::read("no-such.csv").is_err());
}

proptest! {
    #[test]
    fn no_text_makes_the_reader_panic(text in "\\PC*") {
        let _ = StarCatalogue::parse(Path::new("own.csv"), &text);
        let _ = parse(&text);
    }

    #[test]
    fn far_stars_without_motion_stay_where_they_are(x in -5.0_f64..5.0, z in -5.0_f64..5.0, tdb_s in -3e9_f64..3e9) {
        let catalogue = parse("a,123.4,-56.7,0,0,0,4.5,\n").unwrap();
        let star = &catalogue.stars()[0];
        let place = DVec3::new(x, 1.0, z) * ASTRONOMICAL_UNIT_M;
        prop_assert!((star.direction_from(place, tdb_s) - star.direction).length() < 1e-15);
    }
}
