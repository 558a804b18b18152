"""When a contradiction is told, and when torques are not valid because of it: the numbers, and why they are so.

Each must be beyond what honest errors of a vehicle file do (mass 20 %, inertias and torque 10 %, tyre radius 2 %)
and below what a mistake does (a sign, a factor of two, a wrong gear, the other clutch).
"""

PERIOD_US = 20_000
"""Inputs are looked at so often: speeds of a production bus are renewed every 10 to 20 ms."""
GAP_US = 300_000
"""After a longer silence filters begin anew; what was counted stays."""
DECIDE_EVERY = 5
"""Looks from one verdict to the next, and from one equation of a regression to the next: 0.1 s."""
EQUATION_S = PERIOD_US * 1e-6 * DECIDE_EVERY
"""What an equation stands for."""
MEMORY_S = 90.0
"""Evidence fades with this time constant, counted in seconds of evidence: traffic shows everything within it."""
STANDS_ON = 0.8
"""A finding stands until it is below this share of what it takes to be told: no flutter."""
CERTAIN = 3.0
"""Standard errors by which a regression must be beyond its threshold."""

STEADY_US = 500_000
"""A gear counts when it has been in for so long: a synchroniser and the swing after it are over."""
ROLLS_RAD_S = 8.0
"""Wheels must turn so fast for a ratio: 0.02 rad/s of noise and 10 ms of delay are then below 1 %."""
RATIO_RATE = 0.5
"""Speeds that change by a larger share in a second are left out: those 40 ms late are 2 % off then."""
RATIO_S = 1.5
"""Seconds in a gear that a mean ratio needs."""
RATIO_SHARE = 0.035
"""Deviation of a ratio that is told: tyres differ by 2 % with wear and pressure, slip of driven ones adds none."""
RATIO_SHARE_STRONG = 0.042
"""… and from which torques are not valid: the filter then sees a clutch slip that is none."""
SAME_SHARE = 0.015
"""Gears whose ratios are off by the same within this are off for one reason."""
FITS_SHARE = 0.08
"""A shaft fits its gear within this: neighbouring gears of one shaft are 50 % apart, wheels may be 5 % off."""
OTHER_SHARE = 0.04
"""… and fits another gear than the one told, or the other shaft's, within this."""
MISREAD_S = 2.0
"""Seconds that a shaft turns as another gear than told before it is called misread: no shift takes so long."""
MISREAD_PART = 0.3
"""… as a part of all time in gear."""

LATE_S = 0.03
"""Delay of the wheels against the shafts, beyond the one that the file has, from which on it is told and torques
are not valid. Less is made up for without harm; of more, half is taken for one of shafts against the engine."""
LATE_SIGMA = 0.1
"""… and the share of it that its standard deviation must be below: it has been measured."""

LITTLE_PULL = 0.1
"""Force of the driven tyres, as a share of the weight, up to which they slip less than 1 %: ratios may then be
compared with undriven wheels, where no driven one is measured."""
AXLE_SLOPE = 0.003
"""Slip per m/s² by which the driven wheels must be slower before they are called undriven: a driven axle with half
the load and the stiffest tyres (C = 30) has +0.007, and 10 ms between both messages at 50 km/h make 0.0002."""
AXLE_S = 6.0
"""Seconds without brake that this needs."""
SLIP_ROLLS_RAD_S = 12.0
"""Slip is told from so fast wheels on: slower, 0.02 rad/s of noise are as much as the slip."""

TOGETHER_RAD_S = 4.0
"""Engine and shaft are together within this: noise, resolution and 10 ms at 200 rad/s²."""
TOGETHER_US = 400_000
"""… for so long: crossing speeds part again before."""
APART_RAD_S = 20.0
"""A clutch that slides by as much is not about to lock."""
RIDES_RAD_S = 60.0
"""Way of the engine's speed, together with the shaft of a clutch that is called open, that is told: 600 rpm up or
down. Two speeds that are not tied together do not stay within 4 rad/s over it."""
RIDES_PART = 0.3
"""… as a part of the whole way that they went together lately."""
CLOSED_SLIDES_S = 4.0
"""Seconds without a break that a clutch is called closed and slides while the other one holds the engine. A shift
is done in 2 s; at 10 N·m and 100 rad/s the clutch would take 1 kW."""
SLIDES_PART = 0.2
"""Part of the time that it slides like that lately, from which on it is still called closed too often."""
REST_S = 1.0
"""Seconds at rest from which on both clutches are known to be called open, or closed, there."""
LAUNCH_NM = 30.0
"""Torque that the engine gives away while both clutches are called open: six times the drag of cold oil."""
LAUNCH_M_S2 = 0.5
"""… while the car gathers speed."""
LAUNCH_S = 0.6
"""… for so long in all: half a launch."""
LAUNCH_PART = 0.3
"""… as a part of all launches."""

OFFSET_NM = 20.0
"""Mean engine torque at idle that is told. Drag of two open clutches with 0.05 N·m·s/rad at 85 rad/s is 8 N·m, and
an honest torque is right to some 5 N·m."""
OFFSET_STRONG_NM = 28.0
"""… and from which torques are not valid: more than the σ of any valid clutch torque."""
OFFSET_S = 1.5
"""Seconds of idling that it takes."""
IDLES_RAD_S = 40.0
"""An engine slower than this is not running on its own."""
STEADY_RAD_S2 = 25.0
"""While it changes faster, its inertia hides the mean."""

FACTOR_LOW, FACTOR_HIGH = 0.6, 1.5
"""Torque over acceleration of the car, as a share of what the file says, outside of which it is told. A mass wrong
by 20 %, a torque by 8 % and a squared radius by 4 % make 0.70 to 1.35 at worst."""
STRONG_LOW, STRONG_HIGH = 0.55, 2.2
"""… and outside of which no torque is valid, if it may be the mass: a full load or a trailer is told, no more."""
BOTH_LOW, BOTH_HIGH = 0.65, 1.6
"""The same where the accelerations of the engine alone agree: an inertia wrong by 10 %, a torque by 8 % and a lag
of 60 ms make 0.75 to 1.3 there, in the first half minute up to 1.5, with a mass wrong to the same side."""
SLIPPING_LOW, SLIPPING_HIGH = 0.35, 2.5
"""The same where only driven wheels are measured: they also turn with the slip of the tyres, by as much again."""
TWICE = 2.0
"""Standard errors by which the engine's factor must be beyond that: there are two witnesses."""
INERTIA_LOW, INERTIA_HIGH = 0.4, 2.2
"""The same of the engine alone: its lag of 60 ms, and clutches that begin to grip, make more of an error there."""
SAME_FACTOR = 1.6
"""Both factors that agree within this come from the torque; else they are different things."""
KNOWN_SHARE = 0.25
"""Relative standard error to which a factor counts as known."""
CORRELATED_S = 1.0
"""Errors of the equations last for so long: grade, wind, efficiency. Fewer are independent by that."""
PRIOR_ERROR = 2.0
"""Standard deviation of both factors before anything is known: nothing is believed of them."""
APART_S = 0.5
"""Seconds of them with the engine turning apart from the car: locked to it, only the sum of inertias shows."""
REGRESSION_S = 10.0
"""Seconds of equations that a verdict needs."""
SMOOTH_S = 0.2
"""Time constant to which torque and accelerations are smoothed alike."""
LASTING_S = 1.5
"""What lasts longer than this drops out of the equations: grade, wind, offsets."""
BRAKE_US = 700_000
"""The brake must have been off for so long."""
MOST_NEGATIVE = -4.0
"""A wrong sign is certain where torque explains a part of the accelerations: the most of a factor is not below
this."""

GRADE = 0.2
"""Mean grade that the road load means, from which on it is told: roads of 15 % over a kilometre exist, and with a
load of a fifth of the mass they look like 18 %."""
GRADE_STRONG = 0.25
"""… and from which torques are not valid."""
GRADE_M = 1000.0
"""Way in which evidence of grades fades."""
GRADE_SHARE = 0.63
"""Share of it that must have been driven: what is left of a kilometre."""
