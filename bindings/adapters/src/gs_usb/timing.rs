//! The bit timing for a bit rate, from the clock and the limits of a CAN controller.

use super::protocol::{BitTiming, ChannelConstants};

/// Sample point in thousandths of the bit time. CiA 301 recommends 87.5 %; above 500 kbit/s Linux uses 80 %, above
/// 800 kbit/s 75 % (drivers/net/can/dev/calc_bittiming.c).
const fn sample_point(bit_rate: u32) -> u64 {
    match bit_rate {
        800_001.. => 750,
        500_001.. => 800,
        _ => 875,
    }
}

/// The timing that gives exactly `bit_rate` (bit/s), with the sample point nearest to the recommended one; of several, the
/// one with most time quanta. `None` if the clock does not give this rate.
pub(super) fn find_timing(constants: &ChannelConstants, bit_rate: u32) -> Option<BitTiming> {
    let (first, last) = constants.prescaler;
    let step = usize::try_from(constants.prescaler_step).ok().filter(|step| *step > 0)?;
    let target = sample_point(bit_rate);
    // Larger prescalers leave less than one quantum per bit.
    let last = last.min(constants.clock.checked_div(bit_rate)?);
    let exact = (first.max(1)..=last).step_by(step).filter_map(|prescaler| {
        let per_quantum = u64::from(prescaler).checked_mul(u64::from(bit_rate))?;
        let clock = u64::from(constants.clock);
        (clock.checked_rem(per_quantum)? == 0).then_some((prescaler, clock.checked_div(per_quantum)?))
    });
    let segments = exact.filter_map(|(prescaler, quanta)| {
        let (segment_1, segment_2) = split_segments(constants, quanta, target)?;
        let sample = (1 + u64::from(segment_1)).saturating_mul(1_000).checked_div(quanta)?;
        Some((sample.abs_diff(target), prescaler, segment_1, segment_2))
    });
    let (_, prescaler, segment_1, segment_2) =
        segments.min_by_key(|(error, prescaler, ..)| (*error, *prescaler))?;
    let propagation = segment_1 / 2;
    Some(BitTiming {
        propagation,
        phase_1: segment_1.saturating_sub(propagation),
        phase_2: segment_2,
        jump_width: (segment_2 / 2).clamp(1, constants.max_jump_width.max(1)),
        prescaler,
    })
}

/// Segments 1 and 2 of a bit of `quanta` within their limits: one quantum for synchronization, then both segments, between
/// them the sample point.
fn split_segments(constants: &ChannelConstants, quanta: u64, target: u64) -> Option<(u32, u32)> {
    let both = u32::try_from(quanta.checked_sub(1)?).ok()?;
    let (min_1, max_1) = constants.segment_1;
    let (min_2, max_2) = constants.segment_2;
    let least = min_1.max(both.saturating_sub(max_2)).max(1);
    let most = max_1.min(both.checked_sub(min_2.max(1))?);
    if least > most {
        return None;
    }
    let wanted = quanta.checked_mul(target)?.saturating_add(500).checked_div(1_000)?.saturating_sub(1);
    let segment_1 = u32::try_from(wanted).ok()?.clamp(least, most);
    Some((segment_1, both.checked_sub(segment_1)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// candleLight_fw on an STM32F072: 48 MHz, segments 1 to 16 and 1 to 8, prescaler 1 to 1024.
    fn stm32f0() -> ChannelConstants {
        constants([1, 48_000_000, 1, 16, 1, 8, 4, 1, 1_024, 1])
    }

    fn constants(words: [u32; 10]) -> ChannelConstants {
        let bytes: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
        ChannelConstants::parse(&bytes).unwrap()
    }

    /// 48 MHz ÷ 6 = 8 MHz, 16 quanta: sample point (1 + 13) ÷ 16 = 87.5 %; 48 MHz ÷ 3 ÷ 16 = 1 MHz, (1 + 11) ÷ 16 = 75 %.
    #[test]
    fn timings_worked_out_by_hand() {
        let expected = BitTiming { propagation: 6, phase_1: 7, phase_2: 2, jump_width: 1, prescaler: 6 };
        assert_eq!(find_timing(&stm32f0(), 500_000), Some(expected));
        let expected = BitTiming { propagation: 5, phase_1: 6, phase_2: 4, jump_width: 2, prescaler: 3 };
        assert_eq!(find_timing(&stm32f0(), 1_000_000), Some(expected));
    }

    #[test]
    fn each_timing_gives_its_bit_rate() {
        let stm32g4 = constants([1, 170_000_000, 1, 256, 1, 128, 128, 1, 512, 1]);
        for constants in [stm32f0(), stm32g4] {
            for bit_rate in [10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 1_000_000] {
                let found = find_timing(&constants, bit_rate);
                let Some(found) = found else { panic!("{bit_rate}: no timing") };
                let segment_1 = found.propagation + found.phase_1;
                let quanta = 1 + segment_1 + found.phase_2;
                assert_eq!(constants.clock / found.prescaler / quanta, bit_rate);
                assert_eq!(constants.clock % (found.prescaler * quanta), 0);
                let sample = (1 + segment_1) * 1_000 / quanta;
                let target = if bit_rate == 1_000_000 { 750 } else { 875 };
                assert!(sample.abs_diff(target) <= 15, "{bit_rate}: {sample}");
                assert!((1..=constants.segment_2.1).contains(&found.phase_2));
                assert!((1..=found.phase_2).contains(&found.jump_width));
            }
        }
    }

    #[test]
    fn rates_that_the_clock_does_not_give_are_refused() {
        assert_eq!(find_timing(&stm32f0(), 470_000), None);
        assert_eq!(find_timing(&stm32f0(), 48_000_000), None);
        assert_eq!(find_timing(&stm32f0(), 0), None);
    }

    /// Limits that contradict each other, from a faulty device.
    #[test]
    fn impossible_limits_give_no_timing() {
        let max = u32::MAX;
        for words in [
            [1, 48_000_000, 1, 16, 1, 8, 4, 1, 1_024, 0],
            [1, 0, 1, 16, 1, 8, 4, 1, 1_024, 1],
            [1, 48_000_000, 16, 1, 8, 1, 4, 1, 1_024, 1],
            [1, 48_000_000, 1, 16, 1, 8, 4, 1_024, 1, 1],
            [max; 10],
        ] {
            assert_eq!(find_timing(&constants(words), 500_000), None, "{words:?}");
        }
        // Limits of 0 are taken as 1.
        assert!(find_timing(&constants([1, 48_000_000, 0, max, 0, max, 0, 0, max, 1]), 500_000).is_some());
    }
}
