#!/usr/bin/env bash
# The workbench on readings of a power meter: a response calibrated from ten series, then campaigns with one effect each.
#
#     validation/power_meter.sh target/release/retina SERIES DIR
#
# SERIES is the number of series of each campaign. Finished campaigns are kept. Needs Python for its JSON alone.
set -euo pipefail
retina=$1 series=$2 dir=$3/$2 setup=assets/setups/wide-fov.toml
mkdir -p "$dir"
if [ ! -f "$dir/calibration.toml" ]; then
    "$retina" simulate power --setup $setup --seed 1 --series 10 --out "$dir/base" >"$dir/log"
    "$retina" calibrate radiometry --setup $setup --data "$dir/base/power.csv" --out "$dir/calibration.toml" >"$dir/log"
fi
number=100
for effect in none gamma=2.3 gamma=2.25 black_level=1e-4 black_level=5e-4 square_loading=1% square_loading=3% \
    pixel_crosstalk=5% pixel_crosstalk=2% self_heating=1% self_heating=3% ageing=2% ageing=5% meter_zero=0.1nW \
    meter_zero=0.5nW meter_wavelength=2% meter_wavelength=4% meter_nonlinearity=1% meter_nonlinearity=2% \
    channel_nonadditivity=1% channel_nonadditivity=2% attenuator_not_changed=2 attenuator_not_changed=10 none none; do
    number=$((number + 1)) with=()
    [ "$effect" = none ] || with=(--effect "$effect")
    [ -f "$dir/$number/power.csv" ] || "$retina" simulate power --setup $setup --seed $number --series "$series" \
        "${with[@]}" --out "$dir/$number" >"$dir/log"
    printf '%-28s ' "$effect"
    "$retina" diagnose --setup $setup --data "$dir/$number/power.csv" --calibration "$dir/calibration.toml" --json |
        python3 -c 'import json, sys; d = json.load(sys.stdin); print(d["verdict"], d["accepted"], d["indistinguishable"], d["unexplained"]["covariates"])'
done
