//! The network as an ONNX file that takes the camera's whole frame: pooling and scaling are inside, the memory goes in and comes out.
//!
//! | name | type, shape | what |
//! |---|---|---|
//! | in `frame` | u8 `[n, 480, 640, 3]` | the camera's picture, red, green, blue |
//! | in `state` | f32 `[n, 6]` | goal colour as one of three, direction of gravity in the base |
//! | in `recall` | f32 `[n, 398]` | what the robot recalls, see [`crate::recall::RECALL`]; made from odometry and earlier `sight` |
//! | in `memory` | f32 `[n, 192]` | zeros at first, then `next_memory` of the last decision |
//! | out `command` | f32 `[n, 3]` | forwards, to the left \[m/s\], turning to the left \[rad/s\] |
//! | out `shares` | f32 `[n, 3]` | the same as shares of the limits, -1 to 1 |
//! | out `cone` | f32 `[n, 4]` | sine and cosine of its bearing, logarithm of its distance from the base \[m\], probability that it is in view |
//! | out `sight` | f32 `[n, 32]` | what it says of the picture alone, see [`crate::net::SIGHT`] |
//! | out `next_memory` | f32 `[n, 192]` | for the next decision, 0.2 s later |

use crate::NavError;
use crate::net::{COLOUR, COMMAND, HEIGHT, HIDDEN, Net, OUTPUTS, SIGHT, STATE, Tint, WIDTH};
use crate::recall::RECALL;
use crate::sight::COLOURS;
use crate::task::Limits;
use crate::weights::GoalInput;
use qv_policy::net::Dense;
use qv_policy::onnx::{GraphBuilder, Gru, OnnxError, Tensor};

/// Pixels of the camera along each side for one of the network.
pub const POOL: usize = 8;

/// The file. `half_sides` are those of the map's bounds \[m\]: what a share of the place is, for who recalls it.
///
/// # Errors
/// When a number is not finite.
pub fn to_bytes(net: &Net, parameters: &[f32], limits: &Limits, half_sides: [f64; 2]) -> Result<Vec<u8>, NavError> {
    to_bytes_for(net, parameters, limits, half_sides, GoalInput::Name)
}

/// The same of a network that is commanded in some way; metadata `goal` is `colour` where hues of `frame` are to be
/// turned ([`crate::goals::turn_hues`]), and `state` says red.
///
/// # Errors
/// When a number is not finite.
pub fn to_bytes_for(
    net: &Net,
    parameters: &[f32],
    limits: &Limits,
    half_sides: [f64; 2],
    input: GoalInput,
) -> Result<Vec<u8>, NavError> {
    let mut graph = GraphBuilder::new();
    let frame = graph.input_bytes("frame", &[POOL * HEIGHT, POOL * WIDTH, 3])?;
    let state = graph.input("state", STATE)?;
    let recall = graph.input("recall", RECALL)?;
    let memory = graph.input("memory", HIDDEN)?;
    let numbers = graph.to_float(&frame);
    let channels_first = graph.transpose(&numbers, &[0, 3, 1, 2]);
    let pooled = graph.average_pool(&channels_first, POOL);
    let (scale, one) = (graph.constant("scale", &[1], &[2.0 / 255.0])?, graph.constant("one", &[1], &[1.0])?);
    let scaled = graph.mul(&pooled, &scale);
    let mut x = graph.sub(&scaled, &one);
    for (k, conv) in net.convolutions.iter().enumerate() {
        let (plain, bias) = conv.dense.unpadded(parameters);
        let (side, channels, outputs) = (conv.side, conv.from[2], conv.to[2]);
        let taps = side * side;
        // From rows, columns, channels to channels, rows, columns.
        let turned: Vec<f32> = (0..plain.len())
            .map(|at| {
                let (out, channel, tap) = (at / (taps * channels), at / taps % channels, at % taps);
                plain[(out * taps + tap) * channels + channel]
            })
            .collect();
        let weights = graph.constant(&format!("conv_{k}.weights"), &[outputs, channels, side, side], &turned)?;
        let bias = graph.constant(&format!("conv_{k}.bias"), &[outputs], &bias)?;
        let mut y = graph.conv(&x, [&weights, &bias], side, conv.stride, side / 2);
        if let Some(tint) = net.tints.get(k) {
            let shift = self::tint(&mut graph, k, tint, parameters, &state)?;
            // Rows of channels last, so that the shift of each row of the batch meets its own picture.
            let channels_last = graph.transpose(&y, &[2, 3, 0, 1]);
            let shifted = graph.add(&channels_last, &shift);
            y = graph.transpose(&shifted, &[2, 3, 0, 1]);
        }
        x = graph.elu(&y);
    }
    let channels_last = graph.transpose(&x, &[0, 2, 3, 1]);
    let features = graph.flatten(&channels_last);
    let both = graph.concat(&[&features, &state]);
    let dense = dense(&mut graph, "dense", &net.dense, parameters, &both)?;
    let dense = graph.elu(&dense);
    let sight_raw = self::dense(&mut graph, "sight", &net.sight, parameters, &dense)?;
    let before = graph.slice(&sight_raw, 0, 3)?;
    let logit = graph.slice(&sight_raw, 3, 4)?;
    let after = graph.slice(&sight_raw, 4, SIGHT)?;
    let spotted = graph.sigmoid(&logit);
    let sight = graph.concat(&[&before, &spotted, &after]);
    let both = graph.concat(&[&dense, &recall]);
    let mix = self::dense(&mut graph, "mix", &net.mix, parameters, &both)?;
    let mix = graph.elu(&mix);
    let next = gru(&mut graph, net, parameters, &mix, &memory)?;
    let head = self::dense(&mut graph, "head", &net.head, parameters, &next)?;
    let head = graph.elu(&head);
    let raw = self::dense(&mut graph, "last", &net.last, parameters, &head)?;
    let wanted = graph.slice(&raw, 0, COMMAND)?;
    let shares = graph.tanh(&wanted);
    let [low, high] = limits.forwards;
    let half = [0.5 * (high - low), limits.sideways, limits.turning].map(|x| x as f32);
    let half = graph.constant("half_range", &[COMMAND], &half)?;
    let middle = graph.constant("middle", &[COMMAND], &[0.5 * (low + high) as f32, 0.0, 0.0])?;
    let spread = graph.mul(&shares, &half);
    let command = graph.add(&spread, &middle);
    let place = graph.slice(&raw, COMMAND, OUTPUTS - 1)?;
    let logit = graph.slice(&raw, OUTPUTS - 1, OUTPUTS)?;
    let visible = graph.sigmoid(&logit);
    let cone = graph.concat(&[&place, &visible]);
    graph.output(&command, "command", COMMAND)?;
    graph.output(&shares, "shares", COMMAND)?;
    graph.output(&cone, "cone", OUTPUTS - COMMAND)?;
    graph.output(&sight, "sight", SIGHT)?;
    graph.output(&next, "next_memory", HIDDEN)?;
    match input {
        GoalInput::Name => graph.metadata("colours", &COLOURS.join(" ")),
        GoalInput::Colour => graph.metadata("goal", "colour"),
    }
    graph.metadata("half_sides", &half_sides.map(|x| x.to_string()).join(" "));
    graph.metadata("period", &crate::task::PERIOD.to_string());
    Ok(graph.finish())
}

fn dense(
    graph: &mut GraphBuilder,
    name: &str,
    layer: &Dense,
    parameters: &[f32],
    x: &Tensor,
) -> Result<Tensor, OnnxError> {
    let (weights, bias) = layer.unpadded(parameters);
    let weights = graph.constant(&format!("{name}.weights"), &[layer.outputs, layer.inputs], &weights)?;
    let bias = graph.constant(&format!("{name}.bias"), &[layer.outputs], &bias)?;
    Ok(graph.gemm(x, &weights, &bias))
}

/// What the colour adds to each channel.
fn tint(
    graph: &mut GraphBuilder,
    k: usize,
    tint: &Tint,
    parameters: &[f32],
    state: &Tensor,
) -> Result<Tensor, OnnxError> {
    let rows = tint.of(parameters);
    let weights: Vec<f32> =
        (0..tint.channels).flat_map(|o| (0..COLOUR).map(move |c| rows[c * tint.channels + o])).collect();
    let colour = graph.slice(state, 0, COLOUR)?;
    let weights = graph.constant(&format!("tint_{k}.weights"), &[tint.channels, COLOUR], &weights)?;
    let bias = graph.constant(&format!("tint_{k}.bias"), &[tint.channels], &vec![0.0; tint.channels])?;
    Ok(graph.gemm(&colour, &weights, &bias))
}

/// Our gates are r, z, n; those of ONNX are z, r, n.
fn gru(
    graph: &mut GraphBuilder,
    net: &Net,
    parameters: &[f32],
    x: &Tensor,
    memory: &Tensor,
) -> Result<Tensor, OnnxError> {
    let swapped = |rows: Vec<f32>, width: usize| -> Vec<f32> {
        let gate = HIDDEN * width;
        [&rows[gate..2 * gate], &rows[..gate], &rows[2 * gate..3 * gate]].concat()
    };
    let (inputs, hidden) = (net.gru.from_input.inputs, net.gru.hidden);
    let (weights, bias) = net.gru.from_input.unpadded(parameters);
    let (state_weights, state_bias) = net.gru.from_state.unpadded(parameters);
    let gru = Gru {
        inputs,
        hidden,
        input_weights: &swapped(weights, inputs),
        state_weights: &swapped(state_weights, hidden),
        input_bias: &swapped(bias, 1),
        state_bias: &swapped(state_bias, 1),
    };
    graph.gru("memory_step", &gru, x, memory)
}
