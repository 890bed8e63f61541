//! Semi-global aggregation of costs, and the plane that costs least.

use super::options::StereoOptions;
use super::sweep::Costs;
use super::views::View;

/// Inverse depths, 0 where nothing is alike, shape `[height, width]`.
pub fn winners(view: &View, costs: &Costs, options: &StereoOptions) -> Vec<f32> {
    let sums = aggregated(view, costs, options);
    let planes = costs.planes;
    let most = (255.0 * (1.0 - options.least_ncc)) as u8;
    let one = |pixel: usize| {
        let sums = &sums[pixel * planes..(pixel + 1) * planes];
        let mut winner = 0;
        for plane in 1..planes {
            if sums[plane] < sums[winner] {
                winner = plane;
            }
        }
        // At the ends of the range the best may lie beyond it.
        if winner == 0 || winner + 1 == planes || costs.values[pixel * planes + winner] > most {
            return 0.0;
        }
        let [before, at, after] = [-1i32, 0, 1].map(|k| f32::from(sums[(winner as i32 + k) as usize]));
        let bend = before - 2.0 * at + after;
        let off = if bend > 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
        view.inverse_depth(winner as f32 + off)
    };
    (0..view.grey.len()).map(one).collect()
}

/// Steps of the paths, of which each comes with the one the other way.
const WAYS: [[i32; 2]; 4] = [[1, 0], [1, 1], [0, 1], [-1, 1]];

/// Sums over eight paths of the least cost of a path that ends at a pixel on a plane.
fn aggregated(view: &View, costs: &Costs, options: &StereoOptions) -> Vec<i16> {
    let mut sums = vec![0i16; costs.values.len()];
    for way in WAYS {
        for way in [way, way.map(|x| -x)] {
            Path::new(view, costs, options, way).add(&mut sums);
        }
    }
    sums
}

struct Path<'a> {
    view: &'a View,
    costs: &'a Costs,
    way: [i32; 2],
    small: i16,
    large: f32,
    edge: f32,
    /// Costs of the row that is worked on and of the one before, shape `[width, planes + 2]`: a wall at both ends.
    rows: [Vec<i16>; 2],
    /// The least of each pixel.
    least: [Vec<i16>; 2],
}

/// More than any cost of a path, and far from overflow.
const WALL: i16 = i16::MAX / 4;

impl<'a> Path<'a> {
    fn new(view: &'a View, costs: &'a Costs, options: &StereoOptions, way: [i32; 2]) -> Self {
        let row = || vec![WALL; view.width * (costs.planes + 2)];
        Self {
            view,
            costs,
            way,
            small: (255.0 * options.small_jump) as i16,
            large: 255.0 * options.large_jump,
            edge: options.edge,
            rows: [row(), row()],
            least: [vec![0; view.width], vec![0; view.width]],
        }
    }

    fn add(&mut self, sums: &mut [i16]) {
        let (width, height) = (self.view.width as i32, self.view.height as i32);
        let [dx, dy] = self.way;
        let forward = dy > 0 || (dy == 0 && dx > 0);
        for row in 0..height {
            let y = if forward { row } else { height - 1 - row };
            for column in 0..width {
                let x = if dx >= 0 { column } else { width - 1 - column };
                let (px, py) = (x - dx, y - dy);
                let has_one = (0..width).contains(&px) && (0..height).contains(&py);
                self.step(x as usize, y as usize, has_one.then_some((px as usize, py as usize)), sums);
            }
            if dy != 0 {
                self.rows.swap(0, 1);
                self.least.swap(0, 1);
            }
        }
    }

    /// What a large jump costs from one pixel to the next: less where grey changes.
    fn large(&self, a: usize, b: usize) -> i16 {
        let change = (self.view.grey[a] - self.view.grey[b]).abs();
        let large = if change.is_nan() { self.large } else { self.large / (1.0 + change / self.edge) };
        self.small.max(large as i16)
    }

    fn step(&mut self, x: usize, y: usize, before: Option<(usize, usize)>, sums: &mut [i16]) {
        let planes = self.costs.planes;
        let at = y * self.view.width + x;
        let range = at * planes..(at + 1) * planes;
        let (costs, sums) = (&self.costs.values[range.clone()], &mut sums[range]);
        // Row 0 is worked on; the one before is row 1, or row 0 itself where paths run along it.
        let Some((px, py)) = before else {
            let now = &mut self.rows[0][x * (planes + 2) + 1..][..planes];
            for ((now, cost), sum) in now.iter_mut().zip(costs).zip(sums) {
                *now = i16::from(*cost);
                *sum += *now;
            }
            self.least[0][x] = now.iter().copied().min().unwrap_or(0);
            return;
        };
        let large = self.large(at, py * self.view.width + px);
        let from = usize::from(py != y);
        let least = self.least[from][px];
        let [row, other] = &mut self.rows;
        let (now, last): (&mut [i16], &[i16]) = if from == 1 {
            (&mut row[x * (planes + 2)..][..planes + 2], &other[px * (planes + 2)..][..planes + 2])
        } else if px < x {
            let (low, high) = row.split_at_mut(x * (planes + 2));
            (&mut high[..planes + 2], &low[px * (planes + 2)..][..planes + 2])
        } else {
            let (low, high) = row.split_at_mut(px * (planes + 2));
            (&mut low[x * (planes + 2)..][..planes + 2], &high[..planes + 2])
        };
        let jump = least + large;
        let (small, now) = (self.small, &mut now[1..=planes]);
        let mut found = WALL;
        let last = last[..planes].iter().zip(&last[1..=planes]).zip(&last[2..]);
        for (((now, cost), sum), ((low, same), high)) in now.iter_mut().zip(costs).zip(sums).zip(last) {
            let path = (*low.min(high) + small).min(*same).min(jump) - least + i16::from(*cost);
            *now = path;
            *sum += path;
            found = found.min(path);
        }
        self.least[0][x] = found;
    }
}
