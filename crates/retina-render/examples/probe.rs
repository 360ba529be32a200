use std::path::Path;
use std::time::Instant;
use glam::{DMat3, DQuat, DVec3};
use retina_geometry::Setup;
use retina_radiometry::*;
use retina_render::*;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let t = Instant::now();
    let mut body = retina_model::load_body(Path::new(&args[1])).unwrap();
    if args.iter().any(|a| a == "smooth") { body.smooth_normals(); }
    if args.iter().any(|a| a == "notex") { for s in &mut body.surfaces { s.albedo_map = None; s.albedo_factor = 1.0; } }
    println!("load {:?} {} tri", t.elapsed(), body.triangles.len());
    let phase: f64 = args[2].parse().unwrap();
    let dist: f64 = args[3].parse().unwrap();
    let setup = Setup::read(Path::new("assets/setups/narrow-fov.toml")).unwrap();
    let mut image = setup.facility_pinhole();
    if let Some(w) = args.iter().find_map(|a| a.strip_prefix("w=")) { let w: u32 = w.parse().unwrap(); image.width_px = w; image.height_px = w; image.cx_px = w as f64/2.0; image.cy_px = w as f64/2.0; }
    let model = BodyModel { name: "moon".into(), shape: body, photometry: Photometry::new(Law::LunarLambert{decay_rad: 60f64.to_radians()}, PhaseFunction::Constant, Some(0.12)) };
    // camera on +x looking at -x: camera z = -x_body, camera y = -z_body, camera x = z cross.. 
    let cfb = DMat3::from_cols(DVec3::new(0.,0.,-1.), DVec3::new(1.,0.,0.), DVec3::new(0.,-1.,0.)) * DMat3::from_quat(DQuat::from_rotation_z(0.3)*DQuat::from_rotation_y(0.1));
    let a = phase.to_radians();
    let sun_cam = DVec3::new(a.sin(), 0.1*a.sin(), -a.cos()).normalize();
    let state = FrameState { image, distortion: None, bodies: vec![BodyState { position_camera_m: DVec3::new(args.iter().find_map(|a| a.strip_prefix("x=")).map_or(3.3e4, |v| v.parse().unwrap()), -2.2e4, dist), camera_from_body: cfb, sun_position_body_m: cfb.transpose()*sun_cam*AU_M }] };
    let layers = if args.iter().any(|a| a=="layers") { Planes::Layers } else { Planes::RadianceFactor };
    let q = if args.iter().any(|a| a=="best") { Quality::Best } else if args.iter().any(|a| a=="draft") {Quality::Draft} else { Quality::Default };
    let t = Instant::now();
    let gpu = GpuDevice::open().unwrap();
    println!("open {:?} {} {}", t.elapsed(), gpu.name(), gpu.driver());
    let t = Instant::now();
    let mut r = GpuRenderer::new(gpu, vec![model.clone()], q, layers).unwrap();
    println!("new {:?}", t.elapsed());
    let mut img = None;
    for _ in 0..4 {
        let t = Instant::now();
        r.start(&state).unwrap();
        img = r.finish().unwrap();
        println!("frame {:?}", t.elapsed());
    }
    let img = img.unwrap();
    save(&img, "/tmp/gpu.pgm", 1);
    if args.iter().any(|a| a=="cpu") {
        let t = Instant::now();
        let c = CpuRenderer::new(vec![model], CpuSampling { grid: 8, refined_grid: 16, sun_points: 1, contrast: 0.05 }, layers);
        println!("cpu new {:?}", t.elapsed());
        let t = Instant::now();
        let ref_ = c.render(&state);
        println!("cpu frame {:?}", t.elapsed());
        save(&ref_, "/tmp/cpu.pgm", 1);
        let (g, c) = (img.plane(1), ref_.plane(1));
        let lit: Vec<usize> = (0..g.len()).filter(|&i| c[i] > 0.0 || g[i] > 0.0).collect();
        let mean = lit.iter().map(|&i| c[i] as f64).sum::<f64>()/lit.len() as f64;
        let rms = (lit.iter().map(|&i| (g[i]-c[i]).powi(2) as f64).sum::<f64>()/lit.len() as f64).sqrt();
        let mut d: Vec<f64> = lit.iter().map(|&i| (g[i]-c[i]).abs() as f64/mean).collect(); d.sort_by(f64::total_cmp);
        println!("lit {} mean {mean:.5} rms/mean {:.5} p99 {:.4} p99.9 {:.4} max {:.4} flux ratio {:.6}", lit.len(), rms/mean, d[d.len()*99/100], d[d.len()*999/1000], d[d.len()-1],
          g.iter().map(|&v| v as f64).sum::<f64>()/c.iter().map(|&v| v as f64).sum::<f64>());
        if let Some(p) = args.iter().find_map(|a| a.strip_prefix("diff=")) {
            let w=img.width_px as usize; let mut out = format!("P5 {} {} 255\n", w, img.height_px).into_bytes();
            out.extend((0..g.len()).map(|i| ((g[i]-c[i]) as f64/mean*2000.0+128.0).clamp(0.0,255.0) as u8)); std::fs::write(p,out).unwrap();
        }
    }
}
fn save(img: &RadianceImage, path: &str, plane: usize) {
    let p = img.plane(plane); let m = p.iter().fold(0f32, |a,&b| a.max(b));
    let mut out = format!("P5 {} {} 255\n", img.width_px, img.height_px).into_bytes();
    out.extend(p.iter().map(|&v| ((v/m).powf(1.0/2.2)*255.0) as u8));
    std::fs::write(path, out).unwrap();
}
