use super::*;
use crate::time::parse_epoch;

const ARCSEC: f64 = std::f64::consts::PI / 648_000.0;

fn from_earth(tdb_s: f64) -> Observer {
    let earth = Ephemeris::analytic().solar_system(tdb_s).unwrap().earth;
    Observer::new(&Ephemeris::analytic(), tdb_s, earth.position_m, Some(earth.velocity_m_s)).unwrap()
}

#[test]
fn names_come_back() {
    for planet in Planet::ALL {
        assert_eq!(Planet::from_name(planet.name()), Some(planet));
    }
    assert_eq!(Planet::from_name("pluto"), None);
}

#[test]
fn light_that_arrives_left_when_it_must_have() {
    // The definition: |p(t - d / c) - o| = d, met here by a fixed point that needs many positions.
    let tdb_s = parse_epoch("2031-02-03").unwrap();
    let place_m = DVec3::new(0.3, -0.9, 0.2) * ASTRONOMICAL_UNIT_M;
    let observer = Observer::new(&Ephemeris::analytic(), tdb_s, place_m, None).unwrap();
    for planet in Planet::ALL {
        let mut light_s = 0.0;
        for _ in 0..6 {
            light_s = (Ephemeris::analytic().position_m(planet, tdb_s - light_s).unwrap() - place_m).length()
                / LIGHT_SPEED_M_S;
        }
        let seen = seen_planet(&observer, planet).unwrap().unwrap();
        assert!((seen.distance_m - light_s * LIGHT_SPEED_M_S).abs() < 200.0, "{planet:?}");
        let there =
            (Ephemeris::analytic().position_m(planet, tdb_s - light_s).unwrap() - place_m).normalize();
        // What is left is the Sun's deflection, well away from it.
        assert!(separation_rad(seen.direction, there) < 0.05 * ARCSEC, "{planet:?}");
    }
}

#[test]
fn the_venus_transit_of_2012_happened() {
    // Geocentric least distance of centres 554.4 arcsec at 01:29:36 UT on 2012 June 6 (NASA, Espenak).
    let tdb_s = parse_epoch("2012-06-06T01:29:36Z").unwrap();
    let observer = from_earth(tdb_s);
    let venus = seen_planet(&observer, Planet::Venus).unwrap().unwrap();
    let sun = observer.apparent_source(observer.bodies().sun_from_m(observer.position_m()));
    let apart = separation_rad(venus.direction, sun) / ARCSEC;
    assert!((apart - 554.4).abs() < 0.7, "{apart}");
    // Its disc was 57.8 arcsec wide.
    assert!((2.0 * venus.angular_radius_rad / ARCSEC - 57.8).abs() < 0.1);
    assert!(venus.phase_angle_rad.to_degrees() > 179.0 && venus.magnitude.is_finite());
}

#[test]
fn jupiter_and_saturn_met_in_2020() {
    // Great conjunction: 6.1 arcmin apart on 2020 December 21, 18:20 UT (least separation 6'06").
    let observer = from_earth(parse_epoch("2020-12-21T18:20Z").unwrap());
    let [jupiter, saturn] =
        [Planet::Jupiter, Planet::Saturn].map(|planet| seen_planet(&observer, planet).unwrap().unwrap());
    let apart = separation_rad(jupiter.direction, saturn.direction) / ARCSEC;
    assert!((apart - 366.0).abs() < 3.0, "{apart}");
    assert!(!jupiter.magnitude_extrapolated && !saturn.magnitude_extrapolated);
}

#[test]
fn mars_of_the_2003_opposition() {
    // Closest approach 2003 August 27, 09:51 UT: 55.758 million km, 25.11 arcsec wide.
    let observer = from_earth(parse_epoch("2003-08-27T09:51Z").unwrap());
    let mars = seen_planet(&observer, Planet::Mars).unwrap().unwrap();
    assert!((mars.distance_m / 1e9 - 55.758).abs() < 0.002, "{}", mars.distance_m);
    assert!((2.0 * mars.angular_radius_rad / ARCSEC - 25.11).abs() < 0.03);
}

#[test]
fn mars_is_as_bright_as_its_meridian_and_season_make_it() {
    // Cases of Mallama & Hilton's program (Ap_Mag_Input_V3.txt), geocentric: distances, phase, magnitude.
    for (epoch, sun_au, earth_au, phase_deg, expected) in [
        ("2003-08-28T00:00Z", 1.381_191_244_505, 0.372_743_810_979, 4.8948, -2.862),
        ("2004-07-19T00:00Z", 1.664_150_453_905, 2.589_951_645_185, 11.5877, 1.788),
    ] {
        let mars = seen_planet(&from_earth(parse_epoch(epoch).unwrap()), Planet::Mars).unwrap().unwrap();
        assert!((mars.sun_distance_m / ASTRONOMICAL_UNIT_M - sun_au).abs() < 3e-7);
        assert!((mars.distance_m / ASTRONOMICAL_UNIT_M - earth_au).abs() < 3e-7);
        assert!((mars.phase_angle_rad.to_degrees() - phase_deg).abs() < 2e-3);
        assert!((mars.magnitude - expected).abs() < 2e-3, "{}", mars.magnitude);
    }
}

#[test]
fn who_stands_inside_a_planet_does_not_see_it() {
    let seen = seen_planets(&from_earth(0.0)).unwrap();
    assert_eq!(seen.len(), 8);
    assert!(seen.iter().all(|planet| planet.planet != Planet::Earth));
}

#[test]
fn a_cone_holds_the_planets_whose_discs_reach_in() {
    let observer = from_earth(parse_epoch("2020-12-21T18:20Z").unwrap());
    let jupiter = seen_planet(&observer, Planet::Jupiter).unwrap().unwrap();
    let names = |half_angle_arcsec: f64| {
        let seen = planets_in_cone(&observer, jupiter.direction, half_angle_arcsec * ARCSEC).unwrap();
        seen.iter().map(|planet| planet.planet).collect::<Vec<_>>()
    };
    assert_eq!(names(300.0), [Planet::Jupiter]);
    assert_eq!(names(370.0), [Planet::Jupiter, Planet::Saturn]);
    assert_eq!(names(360.0), [Planet::Jupiter, Planet::Saturn], "Saturn's disc is 15 arcsec wide");
    assert_eq!(names(0.0), [Planet::Jupiter]);
}

#[test]
fn epochs_outside_the_theories_are_refused() {
    for planet in Planet::ALL {
        assert!(
            Ephemeris::analytic().position_m(planet, 3.2e9).is_err()
                && Ephemeris::analytic().position_m(planet, f64::NAN).is_err()
        );
    }
}

#[test]
fn ecliptic_coordinates_stand_on_the_obliquity() {
    let pole = from_ecliptic(1.0, std::f64::consts::FRAC_PI_2);
    assert!((pole - DVec3::new(0.0, -0.397776969, 0.917482143)).length() < 1e-8);
    let along = from_ecliptic(1.2, 0.1);
    assert!((ecliptic_longitude_rad(along) - 1.2).abs() < 1e-12);
}
