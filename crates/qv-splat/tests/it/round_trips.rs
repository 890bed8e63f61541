//! What is written is read, within what each format rounds to.

use crate::facts::States;
use crate::made_up::cloud;
use qv_core::GaussianCloud;
use qv_splat::files::spz::{self, Version, write_version};
use qv_splat::files::{FLAT_LOG_SCALE, Format, OPAQUE_LOGIT, compressed_ply, gltf, ply, read_any, write};

fn opacity(logit: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(logit)).exp())
}

/// Largest difference of numbers of two lists.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).fold(0.0, |most, (a, b)| most.max((a - b).abs()))
}

fn opacities_apart(a: &GaussianCloud, b: &GaussianCloud) -> f64 {
    let pairs = a.opacity_logits.iter().zip(&b.opacity_logits);
    pairs.fold(0.0, |most, (a, b)| most.max((opacity(*a) - opacity(*b)).abs()))
}

/// Largest angle between rotations \[rad\], whatever the signs and lengths of the quaternions.
fn angle_apart(a: &GaussianCloud, b: &GaussianCloud) -> f64 {
    let unit = |q: &[f32; 4]| {
        let length = q.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
        q.map(|x| f64::from(x) / length)
    };
    let angle = |a: &[f32; 4], b: &[f32; 4]| {
        let (a, b) = (unit(a), unit(b));
        let sign = if a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
        let chord = a.iter().zip(&b).map(|(a, b)| (a - sign * b).powi(2)).sum::<f64>().sqrt();
        4.0 * (0.5 * chord).asin()
    };
    a.rotations.iter().zip(&b.rotations).fold(0.0, |most, (a, b)| most.max(angle(a, b)))
}

fn constants(cloud: &GaussianCloud) -> Vec<f32> {
    cloud.sh.iter().step_by(cloud.sh_count()).flatten().copied().collect()
}

fn others(cloud: &GaussianCloud) -> Vec<f32> {
    (0..cloud.len()).flat_map(|i| cloud.sh_of(i)[1..].as_flattened().to_vec()).collect()
}

#[test]
fn ply_is_exact() {
    for degree in 0..=3 {
        let cloud = cloud(1000, degree, 5);
        let file = read_any(&write(&cloud, Format::Ply).unwrap()).unwrap();
        assert_eq!((file.cloud, file.format, file.left_out, file.lost), (cloud, Format::Ply, 0, vec![]));
    }
}

#[test]
fn ply_keeps_the_colour_behind_the_scene_in_a_comment() {
    let cloud = cloud(3, 0, 0);
    let bytes = ply::write_over(&cloud, Some([0.25, 0.5, 0.8125])).unwrap();
    let file = ply::read(&bytes).unwrap();
    assert_eq!((file.background, file.cloud), (Some([0.25, 0.5, 0.8125]), cloud.clone()));
    assert_eq!(ply::read(&ply::write(&cloud).unwrap()).unwrap().background, None);
    // What is no colour is a comment like any other.
    for odd in ["0.25 0.5 nan000", "0.25 0.5 1.8125", "0.25 0.5 0.8 12", "0.25 0.5       "] {
        let text = String::from_utf8_lossy(&bytes[..80]).into_owned();
        let at = text.find("0.25 0.5").unwrap();
        let mut other = bytes.clone();
        other[at..at + odd.len()].copy_from_slice(odd.as_bytes());
        assert_eq!(ply::read(&other).unwrap().background, None, "{odd}");
    }
}

#[test]
fn glb_keeps_all_but_the_last_digits() {
    for degree in 0..=3 {
        let cloud = cloud(1000, degree, 2);
        let file = read_any(&write(&cloud, Format::Gltf).unwrap()).unwrap();
        assert_eq!((file.format, file.left_out), (Format::Gltf, 0));
        let back = file.cloud;
        assert_eq!((&back.means, &back.sh, &back.features), (&cloud.means, &cloud.sh, &cloud.features));
        assert!(apart(back.log_scales.as_flattened(), cloud.log_scales.as_flattened()) < 1e-6);
        assert!(opacities_apart(&back, &cloud) < 1e-7);
        assert!(angle_apart(&back, &cloud) < 1e-6);
    }
}

#[test]
fn compressed_ply_rounds_to_its_steps() {
    for degree in 0..=3 {
        let cloud = cloud(1000, degree, 0);
        let bytes = write(&cloud, Format::CompressedPly).unwrap();
        let file = read_any(&bytes).unwrap();
        assert_eq!((file.format, file.left_out, file.cloud.sh_degree), (Format::CompressedPly, 0, degree));
        let order = compressed_ply::curve_order(&cloud.means);
        let at = |k: usize| order[k] as usize;
        let sorted = GaussianCloud {
            means: (0..1000).map(|k| cloud.means[at(k)]).collect(),
            log_scales: (0..1000).map(|k| cloud.log_scales[at(k)]).collect(),
            rotations: (0..1000).map(|k| cloud.rotations[at(k)]).collect(),
            opacity_logits: (0..1000).map(|k| cloud.opacity_logits[at(k)]).collect(),
            sh: (0..1000).flat_map(|k| cloud.sh_of(at(k)).to_vec()).collect(),
            sh_degree: degree,
            ..Default::default()
        };
        let half = compressed_ply::half_steps(&bytes).unwrap();
        assert_eq!(half.len(), 4);
        for i in 0..1000 {
            let (half, sh, back) = (half[i / 256], sorted.sh_of(i), file.cloud.sh_of(i));
            for k in 0..3 {
                let near = |a: f32, b: f32, half: f32| (a - b).abs() <= 1.001 * half + 2e-6 * a.abs();
                assert!(near(sorted.means[i][k], file.cloud.means[i][k], half.mean[k]));
                assert!(near(sorted.log_scales[i][k], file.cloud.log_scales[i][k], half.log_scale[k]));
                assert!(near(sh[0][k], back[0][k], half.constant[k]));
            }
        }
        assert!(apart(&others(&sorted), &others(&file.cloud)) <= 1.0 / 64.0 + 1e-6);
        assert!(opacities_apart(&sorted, &file.cloud) <= 0.5 / 255.0 + 1e-6);
        assert!(angle_apart(&sorted, &file.cloud) < 5e-3, "{}", angle_apart(&sorted, &file.cloud));
    }
}

#[test]
fn spz_rounds_to_its_steps() {
    for degree in 0..=3 {
        for (version, angle) in [(Version::V2, 0.2), (Version::V3, 5e-3), (Version::V4, 5e-3)] {
            let cloud = cloud(1000, degree, 0);
            let bytes = write_version(&cloud, version).unwrap();
            assert_eq!(bytes.starts_with(b"NGSP"), version == Version::V4);
            let file = read_any(&bytes).unwrap();
            assert_eq!((file.format, file.left_out, file.cloud.sh_degree), (Format::Spz, 0, degree));
            let back = file.cloud;
            assert!(apart(back.means.as_flattened(), cloud.means.as_flattened()) <= 0.5 / 4096.0 + 1e-6);
            assert!(apart(back.log_scales.as_flattened(), cloud.log_scales.as_flattened()) <= 0.5 / 16.0 + 1e-6);
            assert!(apart(&constants(&back), &constants(&cloud)) <= 0.5 / (255.0 * 0.15) + 1e-5);
            assert!(apart(&others(&back), &others(&cloud)) <= 0.5 / 128.0 + 1e-6);
            assert!(opacities_apart(&back, &cloud) <= 0.5 / 255.0 + 1e-6);
            assert!(angle_apart(&back, &cloud) < angle, "{version:?} {}", angle_apart(&back, &cloud));
            // What is rounded already stays as it is.
            let again = read_any(&write_version(&back, version).unwrap()).unwrap().cloud;
            assert_eq!((&again.means, &again.log_scales, &again.sh), (&back.means, &back.log_scales, &back.sh));
            assert!(opacities_apart(&again, &back) == 0.0);
        }
    }
}

#[test]
fn far_positions_have_fewer_fractional_bits() {
    let mut cloud = cloud(10, 0, 0);
    cloud.means[3][1] = -100_000.3;
    let back = spz::read(&spz::write(&cloud).unwrap()).unwrap().cloud;
    assert!(apart(back.means.as_flattened(), cloud.means.as_flattened()) <= 0.5 / 64.0 + 1e-2);
    cloud.means[3][1] = 1e9;
    let error = spz::write(&cloud).unwrap_err().to_string();
    assert!(error.states("1000000000 8388607 1000000000"), "{error}");
}

#[test]
fn empty_clouds_are_clouds() {
    for format in Format::ALL {
        for degree in [0, 3] {
            let empty = GaussianCloud { sh_degree: degree, ..Default::default() };
            let file = read_any(&write(&empty, format).unwrap()).unwrap();
            assert_eq!(file.cloud, empty, "{}", format.name());
        }
    }
    let empty = GaussianCloud::default();
    assert_eq!(read_any(&write_version(&empty, Version::V4).unwrap()).unwrap().cloud, empty);
}

#[test]
fn writers_refuse_what_readers_would_leave_out() {
    for format in Format::ALL {
        let fault = |change: fn(&mut GaussianCloud)| {
            let mut cloud = cloud(5, 1, 0);
            change(&mut cloud);
            write(&cloud, format).unwrap_err().to_string()
        };
        assert!(fault(|c| c.means[2][1] = f32::NAN).states("Gaussian 2"), "{}", format.name());
        assert!(fault(|c| c.rotations[4] = [0.0; 4]).states("Gaussian 4"));
        assert!(fault(|c| c.sh[7][0] = f32::INFINITY).states("Gaussian 1"));
        assert!(fault(|c| c.opacity_logits.truncate(4)).states("opacity"));
    }
}

/// A PLY whose floats are changed by `change`, given Gaussian and property.
fn changed_ply(change: &[(usize, &str, f32)]) -> Vec<u8> {
    let cloud = cloud(6, 0, 0);
    let mut bytes = ply::write(&cloud).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let text = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let names: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("property float ")).collect();
    for (row, name, value) in change {
        let column = names.iter().position(|known| known == name).unwrap();
        let at = end + 4 * (row * names.len() + column);
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }
    bytes
}

#[test]
fn odd_gaussians_are_counted_and_the_good_ones_stay() {
    let bytes = changed_ply(&[
        (1, "x", f32::NAN),
        (2, "scale_1", f32::INFINITY),
        (2, "f_dc_0", f32::NAN),
        (4, "opacity", f32::NAN),
    ]);
    let file = read_any(&bytes).unwrap();
    let all = cloud(6, 0, 0);
    assert_eq!((file.cloud.len(), file.left_out), (3, 3));
    assert_eq!(file.cloud.means, [all.means[0], all.means[3], all.means[5]]);
    assert_eq!(file.cloud.check(), Ok(()));
    let zero: Vec<(usize, &str, f32)> = ["rot_0", "rot_1", "rot_2", "rot_3"].map(|name| (0, name, 0.0)).to_vec();
    assert_eq!(read_any(&changed_ply(&zero)).unwrap().left_out, 1);
}

#[test]
fn opaque_clear_and_flat_are_no_faults() {
    let infinite =
        [(0, "opacity", f32::INFINITY), (1, "opacity", f32::NEG_INFINITY), (2, "scale_2", f32::NEG_INFINITY)];
    let file = read_any(&changed_ply(&infinite)).unwrap();
    assert_eq!((file.left_out, file.cloud.len()), (0, 6));
    assert_eq!(file.cloud.opacity_logits[..2], [OPAQUE_LOGIT, -OPAQUE_LOGIT]);
    assert_eq!(file.cloud.log_scales[2][2], FLAT_LOG_SCALE);
}

#[test]
fn names_and_contents_tell_the_format() {
    assert_eq!(Format::of_name("a/b.compressed.ply"), Some(Format::CompressedPly));
    assert_eq!(Format::of_name("B.PLY"), Some(Format::Ply));
    assert_eq!((Format::of_name("x.spz"), Format::of_name("x.glb")), (Some(Format::Spz), Some(Format::Gltf)));
    assert_eq!(Format::of_name("x.obj"), None);
    for format in Format::ALL {
        assert_eq!(Format::of_content(&write(&cloud(3, 0, 0), format).unwrap()), Ok(format));
    }
}

/// A GLB of one cloud whose node has been changed.
fn placed(cloud: &GaussianCloud, node: &str) -> Vec<u8> {
    let bytes = gltf::write(cloud).unwrap();
    let json = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    let text = std::str::from_utf8(&bytes[20..20 + json]).unwrap().trim_end();
    let mut text = text.replace("\"nodes\":[{\"mesh\":0}]", &format!("\"nodes\":[{node}]")).into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend(((20 + text.len() + bytes.len() - 20 - json) as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(text);
    out.extend(&bytes[20 + json..]);
    out
}

#[test]
fn nodes_place_what_they_hold() {
    let cloud = cloud(20, 3, 0);
    let half = 0.5f32.sqrt();
    // A quarter turn about z, twice the size, then moved.
    let node = format!("{{\"mesh\":0,\"translation\":[1,2,3],\"rotation\":[0,0,{half},{half}],\"scale\":[2,2,2]}}");
    let file = read_any(&placed(&cloud, &node)).unwrap();
    for i in 0..20 {
        let [x, y, z] = cloud.means[i];
        assert!(apart(&file.cloud.means[i], &[1.0 - 2.0 * y, 2.0 + 2.0 * x, 3.0 + 2.0 * z]) < 1e-4);
        let grown = cloud.log_scales[i].map(|log| log + 2f32.ln());
        assert!(apart(&file.cloud.log_scales[i], &grown) < 1e-5);
        // The first degree's functions are -y, z, -x; x becomes y and y becomes -x.
        let (before, after) = (cloud.sh_of(i), file.cloud.sh_of(i));
        assert!(apart(&after[1], &before[3]) < 1e-5 && apart(&after[2], &before[2]) < 1e-5);
        assert!(apart(&after[3], &before[1].map(|c| -c)) < 1e-5);
    }
    let matrix = "{\"mesh\":0,\"matrix\":[0,2,0,0,-2,0,0,0,0,0,2,0,1,2,3,1]}";
    let same = read_any(&placed(&cloud, matrix)).unwrap();
    assert!(apart(same.cloud.means.as_flattened(), file.cloud.means.as_flattened()) < 1e-5);
    assert!(angle_apart(&same.cloud, &file.cloud) < 1e-5);
}

#[test]
fn transforms_that_shear_or_mirror_are_errors() {
    let cloud = cloud(2, 0, 0);
    for scale in ["[1,1,2]", "[-1,1,1]", "[0,0,0]"] {
        let node = format!("{{\"mesh\":0,\"scale\":{scale}}}");
        let error = read_any(&placed(&cloud, &node)).unwrap_err().to_string();
        assert!(error.states("positive"), "{scale}: {error}");
    }
    let cycle = read_any(&placed(&cloud, "{\"children\":[0]}")).unwrap_err().to_string();
    assert!(cycle.states("inside"), "{cycle}");
    let many = vec!["{\"mesh\":0}"; 500].join(",");
    let again = format!(
        "{{\"mesh\":0,\"children\":[{}]}},{many}",
        (1..500).map(|i| i.to_string()).collect::<Vec<_>>().join(",")
    );
    assert!(read_any(&placed(&cloud, &again)).unwrap_err().to_string().states("Gaussians"));
}
