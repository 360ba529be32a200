//! What a scenario's files become: camera, Sun, display, bodies, notes.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::Folder;
use glam::{DQuat, DVec3};
use retina_corto::{Shown, row};
use retina_scene::Display;
use retina_screen::Transfer;

fn noted(notes: &[String], words: &str) -> bool {
    notes.iter().any(|note| note.contains(words))
}

#[test]
fn camera_sun_and_display_are_blenders() {
    let folder = Folder::new();
    let scenario = folder.read().unwrap();
    let pinhole = scenario.settings.pinhole();
    // 32 px are half of the larger side: 32 / tan(10 deg) = 181.481 (tan 10 deg = 0.17632698).
    assert!((pinhole.fx_px - 32.0 / 0.176_326_98).abs() < 1e-5 && pinhole.fx_px == pinhole.fy_px);
    assert_eq!((pinhole.cx_px, pinhole.cy_px), (32.0, 24.0));
    let (scene, _) = scenario.scene(&Shown::Camera, true).unwrap();
    let Display::Plain(display) = scene.display else { panic!("{:?}", scene.display) };
    // Blender: a Lambert surface of albedo a has radiance a E / pi face-on, times the exposure.
    assert!((display.gain - 0.5 * 4.0 / std::f64::consts::PI).abs() < 1e-15);
    assert_eq!((display.transfer, display.bits, display.channels), (Transfer::Linear, 16, 1));
    let frame = scene.frame(1).unwrap();
    // Blender's camera at z = 12 looks down: the body at x = 0.5 is to the right, 12 ahead.
    assert!((frame.bodies[0].position_camera_m - DVec3::new(0.5, 0.0, 12.0)).length() < 1e-12);
    let sun = frame.bodies[0].sun_position_body_m;
    // The direction is from the world's origin, and the disc has 0.53 deg: 6.957e8 m seen under
    // 0.265 deg.
    assert!((sun.normalize() - DVec3::Z).length() < 1e-15);
    assert!((sun.length() * 0.265f64.to_radians().sin() - 6.957e8).abs() < 1.0);
}

#[test]
fn a_portrait_image_has_its_field_along_the_height() {
    let folder = Folder::new();
    folder.edit("scene/scene.json", "\"res_x\": 64, \"res_y\": 48", "\"res_x\": 48, \"res_y\": 64");
    let pinhole = folder.read().unwrap().settings.pinhole();
    assert!((pinhole.fy_px - 32.0 / 0.176_326_98).abs() < 1e-5);
    assert_eq!((pinhole.width_px, pinhole.cx_px), (48, 24.0));
}

#[test]
fn what_is_not_supported_or_guessed_is_named() {
    let folder = Folder::new();
    folder.edit("scene/scene.json", "\"Raw\"", "\"Filmic\"");
    folder.edit("scene/scene.json", "\"CYCLES\"", "\"BLENDER_EEVEE\"");
    folder.edit(
        "scene/scene.json",
        "\"pass_index\": 3",
        "\"diffuse_bounces\": 4, \"glossy_bounces\": 0, \"colour\": 1",
    );
    folder.edit("scene/scene.json", "181.48, 0, 32", "200, 0, 32");
    folder.edit("geometry/geometry.json", "\"sun\": {", "\"moon\": {}, \"sun\": {");
    let scenario = folder.read().unwrap();
    let notes = &scenario.notes;
    assert_eq!(scenario.settings.transfer, Transfer::Srgb);
    for words in [
        "Filmic is not supported; in its place Standard",
        "BLENDER_EEVEE",
        "`body_settings`: diffuse_bounces above 0",
        "`body_settings.colour` is not known",
        "guessed: `body_settings.pass_index` = 1",
        "K` is not the camera",
        "clip_start",
        "`moon` is not known",
        "guessed: body 1 is ",
        "cube.obj",
        "set_scale = 1",
        "albedo 0.2",
        "a Blender unit is 1 m",
        "samples",
    ] {
        assert!(noted(notes, words), "{words}: {notes:#?}");
    }
    assert!(!noted(notes, "glossy_bounces"));
}

#[test]
fn a_sidecar_says_what_would_be_guessed() {
    let folder = Folder::new();
    folder.write("body/shape/other.obj", common::CUBE);
    folder.write(
        "retina.toml",
        "schema = 'retina.corto-sidecar/1'\nscale_m_per_bu = 100.0\n[[body]]\nname = 'rock'\nfile = 'other.obj'\n\
         set_scale = [1, 2, 3]\nphotometry = { model = 'lommel-seeliger', normal_albedo = 0.1 }\n",
    );
    let scenario = folder.read().unwrap();
    assert!(!noted(&scenario.notes, "guessed: body") && noted(&scenario.notes, "retina.toml"));
    let (scene, _) = scenario.scene(&Shown::Camera, true).unwrap();
    assert_eq!(scene.bodies[0].name, "rock");
    assert!((scene.bodies[0].bounding_radius_m - 100.0 * 14f64.sqrt()).abs() < 1e-9);
    assert!((scene.frame(0).unwrap().bodies[0].position_camera_m.z - 1000.0).abs() < 1e-9);
}

#[test]
fn several_bodies_come_by_number() {
    let folder = Folder::new();
    folder.edit(
        "scene/scene.json",
        "\"body_settings\": { \"pass_index\": 3 }",
        "\"body_settings_1\": {\"pass_index\": 1}, \"body_settings_2\": {}",
    );
    folder.write("body/shape/a.obj", common::CUBE);
    folder.edit(
        "geometry/geometry.json",
        "\"body\": {",
        "\"body_2\": { \"position\": [[0, 4, 0], [0, 5, 0]], \"orientation\": [[1, 0, 0, 0], [0, 0, 0, 1]] }, \"body_1\": {",
    );
    let scenario = folder.read().unwrap();
    assert!(noted(&scenario.notes, "body 1 is") && noted(&scenario.notes, "a.obj"));
    let (scene, _) = scenario.scene(&Shown::Camera, true).unwrap();
    assert_eq!(scene.bodies.iter().map(|body| body.name.as_str()).collect::<Vec<_>>(), ["body_1", "body_2"]);
    let frame = scene.frame(1).unwrap();
    assert!((frame.bodies[1].position_camera_m - DVec3::new(0.0, -5.0, 12.0)).length() < 1e-12);
    let folder = Folder::new();
    folder.edit("scene/scene.json", "\"body_settings\"", "\"body_settings_1\"");
    assert_eq!(folder.read().unwrap().world.body_names, ["body"]);
}

#[test]
fn gltf_gets_blenders_axes_and_a_texture_its_own_brightness() {
    let folder = Folder::new();
    let asset = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/bodies/moon.glb");
    std::fs::remove_file(folder.file("body/shape/cube.obj")).unwrap();
    std::fs::copy(asset, folder.file("body/shape/moon.glb")).unwrap();
    let scenario = folder.read().unwrap();
    assert!(noted(&scenario.notes, "(x, -z, y)"));
    folder.write(
        "sidecar.toml",
        "schema = 'retina.corto-sidecar/1'\nscale_m_per_bu = 1e6\n[[body]]\nset_scale = 1e-6\n",
    );
    let sidecar = folder.file("sidecar.toml");
    let scenario = retina_corto::Scenario::read(folder.path(), Some(&sidecar)).unwrap();
    let (turned, _) = scenario.scene(&Shown::Camera, true).unwrap();
    let body = retina_model::load_body(asset.as_ref()).unwrap();
    for i in [0, 1000, 100_000] {
        let file = body.vertices[i].position_m;
        let object = turned.models()[0].shape.vertices[i].position_m;
        assert!((object - DVec3::new(file.x, -file.z, file.y)).length() < 1e-3, "{file} {object}");
    }
    // A grey texture of code 128 has a linear value of 0.215861 (IEC 61966-2-1).
    let folder = Folder::new();
    std::fs::create_dir_all(folder.file("body/albedo")).unwrap();
    image::GrayImage::from_pixel(8, 4, image::Luma([128])).save(folder.file("body/albedo/map.png")).unwrap();
    let scenario = folder.read().unwrap();
    assert!(noted(&scenario.notes, "map.png") && noted(&scenario.notes, "texture's own values"));
    let (scene, notes) = scenario.scene(&Shown::Camera, true).unwrap();
    assert!(noted(&notes, "longitude and latitude"));
    let face_on = retina_radiometry::Geometry { mu0: 1.0, mu: 1.0, phase_rad: 0.0 };
    assert!((scene.bodies[0].photometry.radiance_factor(face_on) - 0.215_861).abs() < 1e-5);
}

#[test]
fn point_clouds_are_read_and_written() {
    let folder = Folder::new();
    std::fs::remove_file(folder.file("geometry/geometry.json")).unwrap();
    let text = "0 1 2 3 1 0 0 0 4 5 6 0 1 0 0 7 8 9\n# a comment\n\n60.5, 1, 2, 3, 0, 0, 0, 1, 4, 5, 6, 0, 0, 1, 0, 7, 8, 9\n";
    folder.write("geometry/cloud.txt", text);
    let scenario = folder.read().unwrap();
    assert_eq!(scenario.poses.len(), 2);
    let pose = &scenario.poses[1];
    assert_eq!((pose.time_s, pose.bodies[0].position_bu), (60.5, DVec3::new(1.0, 2.0, 3.0)));
    assert_eq!(pose.camera.world_from_object, DQuat::from_xyzw(0.0, 1.0, 0.0, 0.0));
    assert_eq!(row(&scenario.poses[0]), "0 1 2 3 1 0 0 0 4 5 6 0 1 0 0 7 8 9\n");
}

#[test]
fn without_a_geometry_file_there_is_one_frame() {
    let folder = Folder::new();
    std::fs::remove_file(folder.file("geometry/geometry.json")).unwrap();
    let scenario = folder.read().unwrap();
    assert_eq!(scenario.poses, [retina_corto::default_pose(1)]);
    assert!(noted(&scenario.notes, "no geometry file"));
    // All at the origin: the camera is inside the body.
    assert!(folder.refusal().contains("inside the body"));
}

#[test]
fn masks_tell_bodies_apart() {
    use retina_batch::SideProducts as _;
    let folder = Folder::new();
    // Two cubes of edge 2, the second 4 up (Blender's +y) and 3 nearer; the camera at z = 10 or 12.
    folder.edit(
        "scene/scene.json",
        "\"body_settings\": { \"pass_index\": 3 }",
        "\"body_settings_1\": {\"pass_index\": 5}, \"body_settings_2\": {\"pass_index\": 2}",
    );
    folder.edit("scene/scene.json", "\"fov\": 20.0", "\"fov\": 100.0");
    folder.write("body/shape/a.obj", common::CUBE);
    folder.edit(
        "geometry/geometry.json",
        "\"body\": {",
        "\"body_2\": { \"position\": [[0, 4, 3], [0, 5, 3]], \"orientation\": [[1, 0, 0, 0], [1, 0, 0, 0]] }, \"body_1\": {",
    );
    // The Sun a little above the camera, so that the undersides see nothing of its disc.
    folder.edit("geometry/geometry.json", "[[0, 0, 1000]", "[[0, 100, 1000]");
    let flat = "[[body]]\nshading = 'flat'\n";
    folder.write("retina.toml", &format!("schema = 'retina.corto-sidecar/1'\n{flat}{flat}"));
    let scenario = folder.read().unwrap();
    let (mut scene, _) = scenario.scene(&Shown::Camera, true).unwrap();
    let wanted = [retina_corto::Product::Mask];
    let products = retina_corto::Products::of(&scenario, &Shown::Camera, &scene, &wanted).unwrap();
    let files = products.files(0);
    assert_eq!(files[0], "mask_ID_2/000000.png");
    assert_eq!(files[3], "mask_ID_shadow_5/000000.png");
    let frame = scene.frame(0).unwrap();
    let renderer = retina_render::CpuRenderer::new(
        scene.take_models(),
        retina_render::Quality::Best.into(),
        products.planes(),
    );
    let image = renderer.render(&frame.state(scene.image, None));
    let made = products.make(&frame, &image, &[]).unwrap();
    // Half the field is 50 deg over 32 px: f = 32 / tan 50 deg = 26.851 px. The front faces of the
    // cubes are 9 and 6 ahead: rows 24 +- 26.851 / 9 and 24 - 26.851 (4 -+ 1) / 6; the Sun lights
    // the front faces alone. The second cube's underside shows too, down to 24 - 26.851 * 3 / 8.
    let rows = |png: &[u8]| {
        let mask = image::load_from_memory(png).unwrap().into_luma8();
        let set: Vec<u32> = mask.enumerate_pixels().filter(|(.., p)| p.0[0] > 0).map(|(_, y, _)| y).collect();
        (*set.iter().min().unwrap(), *set.iter().max().unwrap() + 1)
    };
    assert_eq!(rows(&made[2]), (21, 27));
    assert_eq!(rows(&made[3]), (21, 27));
    assert_eq!(rows(&made[0]), (2, 14));
    // What is lit is part of the body: of row 1 less than half is covered.
    assert_eq!(rows(&made[1]), (2, 11));
    // Nearer to each other they are not told apart.
    folder.edit("geometry/geometry.json", "[0, 4, 3]", "[0, 2.5, 1]");
    let scenario = folder.read().unwrap();
    let (scene, _) = scenario.scene(&Shown::Camera, true).unwrap();
    let error =
        retina_corto::Products::of(&scenario, &Shown::Camera, &scene, &wanted).unwrap_err().to_string();
    assert!(error.contains("frame 0: `body_1` and `body_2` are too near"), "{error}");
}
