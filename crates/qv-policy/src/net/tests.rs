use super::*;

/// The definition in double precision, without padding.
fn slow(net: &Mlp, parameters: &[f32], input: &[f64]) -> Vec<f64> {
    let mut values = input.to_vec();
    for (k, layer) in net.layers.iter().enumerate() {
        let (weights, bias) = layer.unpadded(parameters);
        let row = |o: usize| weights[o * layer.inputs..][..layer.inputs].iter().zip(&values);
        let sum = |o: usize| f64::from(bias[o]) + row(o).map(|(w, x)| f64::from(*w) * x).sum::<f64>();
        let out: Vec<f64> = (0..layer.outputs).map(sum).collect();
        let last = k + 1 == net.layers.len();
        values = out.iter().map(|&x| if last || x > 0.0 { x } else { x.exp_m1() }).collect();
    }
    values
}

fn made_up(net: &Mlp, rows: usize) -> (Vec<f32>, Vec<Vec<f64>>, Vec<f32>) {
    let mut random = Xoshiro256PlusPlus::new(5);
    let mut parameters = net.draw(1.0, &mut random);
    for layer in &net.layers {
        // Biases are drawn as zeros: here they are not.
        (0..layer.outputs).for_each(|o| parameters[layer.bias_at() + o] = random.between(-0.3, 0.3));
    }
    let inputs: Vec<Vec<f64>> =
        (0..rows).map(|_| (0..net.inputs()).map(|_| f64::from(random.normal())).collect()).collect();
    let width = padded(net.inputs());
    let mut flat = vec![0.0; rows * width];
    for (row, input) in inputs.iter().enumerate() {
        input.iter().enumerate().for_each(|(i, &x)| flat[row * width + i] = x as f32);
    }
    (parameters, inputs, flat)
}

#[test]
fn forward_is_the_definition() {
    let net = Mlp::new(&[45, 64, 48, 12]);
    let (parameters, inputs, flat) = made_up(&net, 13);
    let mut tape = net.tape(20);
    let out = net.forward(&parameters, 13, &flat, &mut tape);
    for (row, input) in inputs.iter().enumerate() {
        for (o, expected) in slow(&net, &parameters, input).into_iter().enumerate() {
            let found = f64::from(out[row * padded(12) + o]);
            assert!((found - expected).abs() < 1e-5, "{found} for {expected}");
        }
        let single: Vec<f32> = input.iter().map(|&x| x as f32).collect();
        assert_eq!(net.evaluate(&parameters, &single), out[row * padded(12)..][..12], "one row has the same bits");
    }
}

#[test]
fn backward_is_the_slope_of_forward() {
    let net = Mlp::new(&[7, 20, 17, 5]);
    let rows = 9;
    let (parameters, inputs, flat) = made_up(&net, rows);
    let mut random = Xoshiro256PlusPlus::new(11);
    // A loss that is linear in the output.
    let mut of_output = vec![0.0; rows * padded(5)];
    (0..rows).for_each(|row| (0..5).for_each(|o| of_output[row * padded(5) + o] = random.normal()));
    let loss = |parameters: &[f32]| -> f64 {
        let part = |row: usize| {
            let out = slow(&net, parameters, &inputs[row]);
            out.iter().enumerate().map(|(o, y)| y * f64::from(of_output[row * padded(5) + o])).sum::<f64>()
        };
        (0..rows).map(part).sum()
    };
    let (mut tape, mut turned, mut gradient) = (net.tape(rows), net.turned(), vec![0.0; net.len()]);
    net.turn(&parameters, &mut turned);
    net.forward(&parameters, rows, &flat, &mut tape);
    net.backward(&turned, rows, &flat, &of_output, &mut tape, &mut gradient);
    let mut checked = 0;
    for layer in &net.layers {
        for (i, o) in [(0, 0), (3, 4), (layer.inputs - 1, layer.outputs - 1), (layer.inputs, 2)] {
            // Row `inputs` stands for the bias here.
            let at = if i == layer.inputs { layer.bias_at() + o } else { layer.start + i * padded(layer.outputs) + o };
            let mut moved = parameters.clone();
            moved[at] += 1e-2;
            let above = loss(&moved);
            moved[at] = parameters[at] - 1e-2;
            let slope = (above - loss(&moved)) / 2e-2;
            assert!((f64::from(gradient[at]) - slope).abs() < 2e-3 * slope.abs().max(1.0), "{} {slope}", gradient[at]);
            checked += 1;
        }
        // Padding gets nothing.
        for o in layer.outputs..padded(layer.outputs) {
            assert_eq!(gradient[layer.bias_at() + o], 0.0);
        }
    }
    assert_eq!(checked, 12);
}
