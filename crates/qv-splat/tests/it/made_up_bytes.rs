//! Files put together byte by byte from the formats' descriptions, without our writers.

use crate::facts::States;
use flate2::{Compression, write::GzEncoder};
use qv_splat::SplatError;
use qv_splat::files::{Format, SplatFile, read_any};
use std::io::Write;

fn near(found: &[f32], expected: &[f32]) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() <= 1e-5 * b.abs().max(1.0), "{found:?}, expected {expected:?}");
    }
}

fn spz_header(version: u32, count: u32, degree: u8, bits: u8, flags: u8, streams: u8) -> Vec<u8> {
    let mut out = b"NGSP".to_vec();
    out.extend(version.to_le_bytes());
    out.extend(count.to_le_bytes());
    out.extend([degree, bits, flags, streams]);
    out
}

fn gzip(parts: &[&[u8]]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    parts.iter().for_each(|part| encoder.write_all(part).unwrap());
    encoder.finish().unwrap()
}

/// What all made-up SPZ files say but for position and rotation.
fn check_common(file: &SplatFile) {
    assert_eq!((file.format, file.left_out, file.cloud.len()), (Format::Spz, 0, 1));
    near(&file.cloud.log_scales[0], &[-10.0, 0.0, 5.9375]);
    near(&file.cloud.sh_of(0)[0], &[-0.5 / 0.15, (100.0 / 255.0 - 0.5) / 0.15, 0.5 / 0.15]);
    near(&[file.cloud.opacity_logits[0]], &[(51.0f32 / 204.0).ln()]);
}

const ALPHA: &[u8] = &[51];
const COLOUR: &[u8] = &[0, 100, 255];
const SCALE: &[u8] = &[0, 160, 255];
/// 1.0, 2.0, -0.5 in 24 bits, 12 of them behind the point.
const POSITION: &[u8] = &[0x00, 0x10, 0x00, 0x00, 0x20, 0x00, 0x00, 0xf8, 0xff];

#[test]
fn spz_1_has_half_floats() {
    let halves: &[u8] = &[0x00, 0x3c, 0x00, 0x40, 0x00, 0xb8];
    let file = read_any(&gzip(&[&spz_header(1, 1, 0, 12, 0, 0), halves, ALPHA, COLOUR, SCALE, &[255, 0, 0]])).unwrap();
    check_common(&file);
    // y up and z back become y down and z forward.
    near(&file.cloud.means[0], &[1.0, -2.0, 0.5]);
}

#[test]
fn spz_2_has_harmonics_and_three_bytes_of_rotation() {
    let sh: &[u8] = &[128, 192, 64, 0, 128, 255, 129, 130, 131];
    let parts = [&spz_header(2, 1, 1, 12, 1, 0)[..], POSITION, ALPHA, COLOUR, SCALE, &[255, 51, 102], sh];
    let file = read_any(&gzip(&parts)).unwrap();
    check_common(&file);
    near(&file.cloud.means[0], &[1.0, -2.0, 0.5]);
    near(&file.cloud.rotations[0], &[0.0, 1.0, 0.6, 0.2]);
    // -y and z change their signs with the world's y and z, -x does not.
    near(&file.cloud.sh_of(0)[1], &[0.0, -0.5, 0.5]);
    near(&file.cloud.sh_of(0)[2], &[1.0, 0.0, -127.0 / 128.0]);
    near(&file.cloud.sh_of(0)[3], &[1.0 / 128.0, 2.0 / 128.0, 3.0 / 128.0]);
}

#[test]
fn spz_3_has_four_bytes_of_rotation() {
    // Largest is x, then y, z, w: y = -100 steps, z = 0, w = 200 steps.
    let word: u32 = (512 | 100) << 20 | 200;
    let rotation = word.to_le_bytes();
    let parts = [&spz_header(3, 1, 0, 12, 0, 0)[..], POSITION, ALPHA, COLOUR, SCALE, &rotation];
    let file = read_any(&gzip(&parts)).unwrap();
    check_common(&file);
    let step = 0.5f32.sqrt() / 511.0;
    let x = (1.0 - (100.0 * step).powi(2) - (200.0 * step).powi(2)).sqrt();
    near(&file.cloud.rotations[0], &[200.0 * step, x, 100.0 * step, 0.0]);
}

fn spz_4(extension: &[u8]) -> Result<SplatFile, SplatError> {
    let rotation = (3u32 << 30).to_le_bytes();
    let mut out = spz_header(4, 1, 0, 12, if extension.is_empty() { 0 } else { 2 }, 5);
    out.extend((32 + extension.len() as u32).to_le_bytes());
    out.resize(32, 0);
    out.extend(extension);
    let arrays = [POSITION, ALPHA, COLOUR, SCALE, &rotation];
    let streams: Vec<Vec<u8>> = arrays.iter().map(|array| zstd::bulk::compress(array, 1).unwrap()).collect();
    for (array, stream) in arrays.iter().zip(&streams) {
        out.extend((stream.len() as u64).to_le_bytes());
        out.extend((array.len() as u64).to_le_bytes());
    }
    out.extend(streams.concat());
    read_any(&out)
}

#[test]
fn spz_4_has_streams_and_records_of_vendors() {
    let file = spz_4(&[]).unwrap();
    check_common(&file);
    near(&file.cloud.rotations[0], &[1.0, 0.0, 0.0, 0.0]);
    let record =
        |kind: u32, payload: &[u8]| [&kind.to_le_bytes(), &(payload.len() as u32).to_le_bytes(), payload].concat();
    let camera = spz_4(&record(0xADBE_0002, &[0; 12])).unwrap();
    assert_eq!(
        (camera.cloud, camera.lost),
        (file.cloud.clone(), vec!["SPZ extension 0xadbe0002, 12 bytes".to_string()])
    );
    let axes = |number: u32| spz_4(&record(0xADBE_0003, &number.to_le_bytes()));
    assert_eq!(axes(4).unwrap().lost, Vec::<String>::new());
    assert!(axes(6).unwrap_err().to_string().states("coordinate 4"));
    assert!(spz_4(&[1, 2, 3]).is_err());
}

#[test]
fn other_versions_are_named() {
    let parts = [&spz_header(9, 1, 0, 12, 0, 0)[..], POSITION];
    let error = read_any(&gzip(&parts)).unwrap_err().to_string();
    assert_eq!(error, "SPZ header, byte 4: expected version 1, 2, 3 in this container, found 9");
}

/// A compressed PLY of one Gaussian in the middle of its chunk, with or without the chunk's range of colours.
fn compressed(coloured: bool) -> Vec<u8> {
    let axes = ["x", "y", "z", "scale_x", "scale_y", "scale_z", "r", "g", "b"];
    let mut header = String::from("ply\nformat binary_little_endian 1.0\nelement chunk 1\n");
    for group in axes.chunks(3).take(if coloured { 3 } else { 2 }) {
        for end in ["min", "max"] {
            group.iter().for_each(|axis| header += &format!("property float {end}_{axis}\n"));
        }
    }
    header += "element vertex 1\nproperty uint packed_position\nproperty uint packed_rotation\n\
        property uint packed_scale\nproperty uint packed_color\nelement sh 1\n";
    (0..9).for_each(|k| header += &format!("property uchar f_rest_{k}\n"));
    let mut out = (header + "end_header\n").into_bytes();
    let ranges: [f32; 18] =
        [0.0, 10.0, -1.0, 4.0, 20.0, 1.0, -6.0, -6.0, -6.0, -2.0, -2.0, -2.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0];
    out.extend(ranges.iter().take(if coloured { 18 } else { 12 }).flat_map(|x| x.to_le_bytes()));
    // Position at both ends and the low end; w largest, then half of the range thrice; scales low, high, low.
    for word in [2047u32 << 21 | 1023 << 11, 1023 << 20, 1023 << 11, 0xff00_80ff] {
        out.extend(word.to_le_bytes());
    }
    out.extend([0, 128, 255, 1, 1, 1, 2, 2, 2]);
    out
}

#[test]
fn compressed_ply_is_unpacked() {
    let cloud = read_any(&compressed(true)).unwrap().cloud;
    near(&cloud.means[0], &[4.0, 20.0, -1.0]);
    near(&cloud.log_scales[0], &[-6.0, -2.0, -6.0]);
    let half = 0.5f32.sqrt();
    // x, y, z at +, -, - of their ranges: too long for a unit, so that the largest is 0.
    near(&cloud.rotations[0], &[0.0, half, -half, -half]);
    let colour = |x: f32| (x - 0.5) / 0.282_094_79;
    near(&cloud.sh_of(0)[0], &[colour(1.0), colour(-1.0), colour(-1.0 + 2.0 * 128.0 / 255.0)]);
    let step = |byte: f32| ((byte + 0.5) / 256.0 - 0.5) * 8.0;
    near(&cloud.sh_of(0)[1], &[-4.0, step(1.0), step(2.0)]);
    near(&cloud.sh_of(0)[3], &[4.0, step(1.0), step(2.0)]);
    let older = read_any(&compressed(false)).unwrap().cloud;
    near(&older.sh_of(0)[0], &[colour(1.0), colour(0.0), colour(128.0 / 255.0)]);
}

fn glb(scale: &str, extension: &str, data: &[u8]) -> Vec<u8> {
    let own = |name: &str, accessor: u32| format!("\"KHR_gaussian_splatting:{name}\":{accessor}");
    let attributes = [own("ROTATION", 1), own("SCALE", 2), own("OPACITY", 3), own("SH_DEGREE_0_COEF_0", 4)].join(",");
    let mut text = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{{\"mesh\":0}}],\"meshes\":[{{\
        \"primitives\":[{{\"mode\":0,\"attributes\":{{\"POSITION\":0,{attributes}}},\"extensions\":{{\
        \"KHR_gaussian_splatting\":{extension}}}}}]}}],\"buffers\":[{{\"byteLength\":{}}}],\"bufferViews\":[\
        {{\"buffer\":0,\"byteLength\":48}}],\"accessors\":[\
        {{\"bufferView\":0,\"componentType\":5126,\"count\":1,\"type\":\"VEC3\"}},\
        {{\"bufferView\":0,\"byteOffset\":12,\"componentType\":5120,\"normalized\":true,\"count\":1,\"type\":\"VEC4\"}},\
        {{\"bufferView\":0,\"byteOffset\":16,\"count\":1,{scale}}},\
        {{\"bufferView\":0,\"byteOffset\":28,\"componentType\":5123,\"normalized\":true,\"count\":1,\"type\":\"SCALAR\"}},\
        {{\"bufferView\":0,\"byteOffset\":32,\"componentType\":5126,\"count\":1,\"type\":\"VEC3\"}}]}}",
        data.len()
    )
    .into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend(((28 + text.len() + data.len()) as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(text);
    out.extend((data.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(data);
    out
}

const ELLIPSE: &str = "{\"kernel\":\"ellipse\",\"colorSpace\":\"srgb_rec709_display\"}";
const FLOATS: &str = "\"componentType\":5126,\"type\":\"VEC3\"";

fn gltf_data(scale: [f32; 3]) -> Vec<u8> {
    let mut data: Vec<u8> = [1.0f32, 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    data.extend([0u8, 127, 0x81, 0]);
    data.extend(scale.iter().flat_map(|x| x.to_le_bytes()));
    data.extend([0x00, 0x80, 0, 0]);
    data.extend([0.1f32, 0.2, 0.3].iter().flat_map(|x| x.to_le_bytes()));
    data.resize(48, 0);
    data
}

#[test]
fn gltf_integers_are_fractions() {
    let file = read_any(&glb(FLOATS, ELLIPSE, &gltf_data([1.0, 0.0, 0.25]))).unwrap();
    let cloud = file.cloud;
    near(&cloud.means[0], &[1.0, 2.0, 3.0]);
    near(&cloud.rotations[0], &[0.0, 0.0, 1.0, -1.0]);
    near(&cloud.log_scales[0], &[0.0, qv_splat::files::FLAT_LOG_SCALE, 0.25f32.ln()]);
    near(&[cloud.opacity_logits[0]], &[(32768.0f32 / 32767.0).ln()]);
    near(&cloud.sh[0], &[0.1, 0.2, 0.3]);
}

#[test]
fn gltf_faults_are_named() {
    let fault =
        |scale: &str, extension: &str, data: &[u8]| read_any(&glb(scale, extension, data)).unwrap_err().to_string();
    let good = gltf_data([1.0; 3]);
    let drafts = fault(FLOATS, ELLIPSE, &gltf_data([-3.0; 3]));
    assert!(drafts.states("logarithms"), "{drafts}");
    let linear = "{\"colorSpace\":\"lin_rec709_display\"}";
    assert!(fault(FLOATS, linear, &good).states("colorSpace srgb_rec709_display lin_rec709_display"));
    assert!(fault(FLOATS, "{\"kernel\":\"box\"}", &good).states("ellipse"));
    let squeezed = "{\"kernel\":\"ellipse\",\"extensions\":{\"KHR_gaussian_splatting_compression_spz_2\":{}}}";
    assert!(fault(FLOATS, squeezed, &good).states("compression"));
    assert!(fault("\"componentType\":5126,\"type\":\"VEC4\"", ELLIPSE, &good).states("2 VEC3"));
    assert!(fault("\"componentType\":5125,\"type\":\"VEC3\"", ELLIPSE, &good).states("5125 5125"));
    let beyond = "\"componentType\":5126,\"type\":\"VEC3\",\"sparse\":{}";
    assert!(fault(beyond, ELLIPSE, &good).states("accessor"));
    assert!(fault(FLOATS, ELLIPSE, &good[..40]).states("byte"));
}
