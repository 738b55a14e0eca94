# usage: sh make.sh RIG OUT, RIG = the command of version 0.1.0
set -u
R=$1; cd "$2"
WHO='--gear SN-010 --sample-rate 100 --seed 10 --json'
SPEEDS='--sync-rate 100 --speeds-rpm 30,100,300,900'
$R gear set SN-010 --part csf-25-120 --mounting circular-spline-fixed --lubricant SK-1A --hours 12.5 --hours-counted "hour meter" --output-radial-runout-um 8 --by "A. Example" --output runs --confirm > /dev/null
$R run home $WHO --operator "A. Example" --output runs > /dev/null
$R run motor-tare $WHO --operator "A. Example" --sync-rate 100 --speeds-rpm 60,300,900 --output runs > /dev/null
$R run friction $WHO $SPEEDS --operator "A. Example" --output runs > /dev/null
$R run friction $WHO $SPEEDS --measure-time 1.5 --operator "A. Example" --output runs > /dev/null
$R import csv foreign.csv --gear SN-010 --start 2026-11-22T03:00:00+00:00 --map foreign.toml --output runs --json > /dev/null
$R config init warm.toml > /dev/null
sed -i 's/^# housing_temperature_deg_c = 60.0/housing_temperature_deg_c = 22.2/' warm.toml
$R run friction $WHO $SPEEDS --config warm.toml --operator "A. Example" --output tripped > /dev/null
$R run friction $WHO --sync-rate 100 --points 100 --operator "A. Example" --output killed > /dev/null & P=$!
while ! [ "$(stat -c %s killed/*.part 2>/dev/null || echo 0)" -gt 140000 ]; do sleep 0.2; done; sleep 0.7; kill -9 $P
$R fit runs/00001-home-SN_010.h5 --json > /dev/null
$R fit runs/00002-motor_tare-SN_010.h5 --json > /dev/null
$R fit runs/00003-friction-SN_010.h5 --tare runs/00002-motor_tare-SN_010.h5 --json > /dev/null
$R fit runs/00004-friction-SN_010.h5 --tare runs/00002-motor_tare-SN_010.h5 --json > /dev/null
