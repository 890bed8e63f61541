//! A policy that learnt nothing but says something, and pictures.

use cone_node::messages::Image;
use qv_core::random::Xoshiro256PlusPlus;
use qv_nav::net::Net;
use qv_nav::onnx::to_bytes;
use qv_nav::task::Limits;

/// policy.onnx of numbers that are drawn.
pub fn policy() -> Vec<u8> {
    let net = Net::default();
    let mut parameters = net.draw(&mut Xoshiro256PlusPlus::new(8));
    // Commands of a size at which errors would be seen.
    parameters.iter_mut().for_each(|p| *p *= 1.3);
    to_bytes(&net, &parameters, &Limits::default(), [3.0, 2.5]).unwrap()
}

/// A picture of noise about a level, blue first, with padded rows.
pub fn picture(level: u8) -> Image {
    let mut random = Xoshiro256PlusPlus::new(u64::from(level));
    let step = 3 * 640 + 8;
    let data = (0..step * 480).map(|_| level + random.below(56) as u8).collect();
    Image { height: 480, width: 640, encoding: "bgr8".into(), step: step as u32, data, ..Image::default() }
}
